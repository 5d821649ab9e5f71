//! Reads a tree that `raykd build MESH -o FILE` saved, with nothing but `raykd-shared`, and walks it.
//!
//! `walk_tree FILE [X Y Z]` prints how the leaves are filled and, if a point is given, the leaf around it.

use raykd_shared::{Content, LAYOUT_VERSION, Node, TreeHeader, TreeView};
use std::{collections::BTreeMap, env, error::Error, fs};

/// The file: magic, version, header, nodes, references, and 32 bytes of SHA-256 over all that. Everything is
/// little-endian words.
struct File {
    header: TreeHeader,
    nodes: Vec<Node>,
    refs: Vec<u32>,
}

impl File {
    fn read(bytes: &[u8]) -> Result<Self, &'static str> {
        let rest = bytes.strip_prefix(b"raykd-kd").ok_or("not a raykd tree file")?;
        let words: Vec<u32> = rest.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
        if words.first() != Some(&LAYOUT_VERSION) {
            return Err("a tree file of another version");
        }
        let [head, body @ ..] = &words[1..] else { return Err("a truncated tree file") };
        // One word at a time, in the order of the header's fields.
        let mut fields = [*head].into_iter().chain(body.iter().copied());
        let mut word = || fields.next().ok_or("a truncated tree file");
        let header = TreeHeader {
            lo: [f32::from_bits(word()?), f32::from_bits(word()?), f32::from_bits(word()?)],
            nodes: word()?,
            hi: [f32::from_bits(word()?), f32::from_bits(word()?), f32::from_bits(word()?)],
            refs: word()?,
            triangles: word()?,
            depth: word()?,
            scale: f32::from_bits(word()?),
            cost_step: f32::from_bits(word()?),
            cost_test: f32::from_bits(word()?),
            mesh: [word()?, word()?],
            checksum: word()?,
        };
        let nodes = (0..header.nodes).map(|_| Ok(Node::from_words(word()?, word()?)));
        let nodes = nodes.collect::<Result<_, _>>()?;
        let refs = (0..header.refs).map(|_| word()).collect::<Result<_, _>>()?;
        Ok(Self { header, nodes, refs })
    }

    fn view(&self) -> TreeView<'_> {
        TreeView { header: &self.header, nodes: &self.nodes, refs: &self.refs }
    }
}

/// The triangles in the leaf around a point, given in the mesh's units, and the leaf's depth.
fn locate(tree: TreeView<'_>, point: [f32; 3]) -> (u32, &[u32]) {
    let (mut node, mut depth) = (0, 0);
    loop {
        match tree.nodes[node as usize].content() {
            Content::Inner { axis, split, below } => {
                let above = point[axis as usize] * tree.header.scale > split;
                node = below + u32::from(above);
                depth += 1;
            }
            Content::Leaf { first, count } => {
                return (depth, &tree.refs[first as usize..(first + count) as usize]);
            }
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let path = arguments.next().ok_or("usage: walk_tree FILE [X Y Z]")?;
    let file = File::read(&fs::read(&path)?)?;
    let tree = file.view();
    // From here on no index leads outside, and every walk ends.
    let report = tree.validate()?;
    println!("{} triangles, {} nodes, depth {}", tree.header.triangles, tree.header.nodes, report.depth);
    println!("{} leaves, {} of them empty", report.leaves, report.empty_leaves);

    let mut sizes = BTreeMap::new();
    let mut waiting = vec![0];
    while let Some(node) = waiting.pop() {
        match tree.nodes[node as usize].content() {
            Content::Inner { below, .. } => waiting.extend([below, below + 1]),
            Content::Leaf { count, .. } => *sizes.entry(count).or_insert(0) += 1,
        }
    }
    for (size, leaves) in sizes {
        println!("{leaves:8} leaves of {size} triangles");
    }

    let point = arguments.map(|x| x.parse()).collect::<Result<Vec<f32>, _>>()?;
    if let Ok(point) = <[f32; 3]>::try_from(point) {
        let (depth, triangles) = locate(tree, point);
        println!("around {point:?}, at depth {depth}: triangles {triangles:?}");
    }
    Ok(())
}
