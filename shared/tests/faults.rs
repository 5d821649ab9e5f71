//! Trees that do not hold together are refused, each with the fault that was planted.

use raykd_shared::{Content, Fault, Node, TreeHeader, TreeView, limits::MAX_DEPTH};

/// A tree of three leaves over the unit cube.
#[derive(Clone)]
struct Parts {
    header: TreeHeader,
    nodes: Vec<Node>,
    refs: Vec<u32>,
}

fn good() -> Parts {
    let nodes = vec![
        Node::inner(0, 0.5, 2),
        Node::PADDING,
        Node::leaf(0, 2),
        Node::inner(1, 0.25, 4),
        Node::leaf(2, 0),
        Node::leaf(2, 3),
    ];
    let header = TreeHeader {
        lo: [0.0; 3],
        nodes: 6,
        hi: [1.0; 3],
        refs: 5,
        triangles: 7,
        depth: 2,
        scale: 1.0,
        cost_step: 1.0,
        cost_test: 2.0,
        mesh: [1, 2],
        checksum: 0,
    };
    let mut parts = Parts { header, nodes, refs: vec![0, 4, 1, 4, 6] };
    parts.header.checksum = parts.view().checksum();
    parts
}

impl Parts {
    fn view(&self) -> TreeView<'_> {
        TreeView { header: &self.header, nodes: &self.nodes, refs: &self.refs }
    }
}

/// What is found in a tree that was made with this fault in it.
fn fault(plant: impl FnOnce(&mut Parts)) -> Option<Fault> {
    let mut parts = good();
    plant(&mut parts);
    parts.header.checksum = parts.view().checksum();
    parts.view().validate().err()
}

#[test]
fn a_good_tree_is_measured() {
    let report = good().view().validate().unwrap();
    assert_eq!((report.inner, report.leaves, report.empty_leaves), (2, 3, 1));
    assert_eq!((report.largest_leaf, report.depth), (3, 2));
    // Half surface areas: root 3, its halves 2, the last leaf 0.5 * 0.75 + 0.75 + 0.5.
    let last: f64 = 0.5 * 0.75 + 0.75 + 0.5;
    let expected = (1.0 + 2.0 / 3.0, 2.0 * 2.0 / 3.0 + 3.0 * last / 3.0);
    assert!((report.expected_steps - expected.0).abs() < 1e-12);
    assert!((report.expected_tests - expected.1).abs() < 1e-12);
    assert!((report.sah_cost - (expected.0 + 2.0 * expected.1)).abs() < 1e-12);
}

#[test]
fn lengths_must_match_the_header() {
    assert_eq!(fault(|p| p.nodes.truncate(5)), Some(Fault::Length));
    assert_eq!(fault(|p| p.refs.push(0)), Some(Fault::Length));
    assert_eq!(fault(|p| (p.header.nodes, p.nodes) = (0, Vec::new())), Some(Fault::Length));
}

#[test]
fn headers_must_be_usable() {
    for plant in [
        (|h| h.lo[1] = f32::NAN) as fn(&mut TreeHeader),
        |h| h.hi[2] = f32::INFINITY,
        |h| h.lo[0] = 2.0,
        |h| h.scale = 0.0,
        |h| h.scale = 3.0,
        |h| h.scale = -1.0,
        |h| h.cost_step = -1.0,
        |h| h.cost_test = f32::NAN,
        |h| h.depth = MAX_DEPTH + 1,
    ] {
        assert_eq!(fault(|p| plant(&mut p.header)), Some(Fault::Header));
    }
}

#[test]
fn children_must_lie_in_the_tree_and_form_one() {
    assert_eq!(fault(|p| p.nodes[3] = Node::inner(1, 0.25, 6)), Some(Fault::Child(3)));
    assert_eq!(fault(|p| p.nodes[3] = Node::inner(1, 0.25, 3)), Some(Fault::Child(3)));
    // Back to the root: would never end.
    assert_eq!(fault(|p| p.nodes[3] = Node::inner(1, 0.25, 0)), Some(Fault::Child(3)));
    // Its own pair.
    assert_eq!(fault(|p| p.nodes[3] = Node::inner(1, 0.25, 2)), Some(Fault::Shape));
    assert_eq!(fault(|p| p.header.depth = 1), Some(Fault::Depth(3)));
    assert_eq!(fault(|p| p.header.depth = 3), Some(Fault::Shape));
    assert_eq!(fault(|p| p.nodes[1] = Node::leaf(0, 1)), Some(Fault::Shape));
    // A leaf instead of a subtree: two nodes are never reached.
    assert_eq!(fault(|p| (p.nodes[3], p.header.depth) = (Node::leaf(2, 3), 1)), Some(Fault::Shape));
}

/// The two halves of the root both lead to one pair, and another pair is never reached: the totals are right.
#[test]
fn no_pair_and_no_reference_is_reached_twice() {
    let pairs = |third| {
        fault(|p| {
            p.header.nodes = 8;
            p.nodes[2] = Node::inner(1, 0.5, 4);
            p.nodes[3] = Node::inner(1, 0.25, third);
            // Without references, which would be reached twice too.
            (p.header.refs, p.refs) = (0, Vec::new());
            p.nodes.truncate(4);
            p.nodes.extend([Node::leaf(0, 0); 4]);
        })
    };
    assert_eq!(pairs(6), None);
    assert_eq!(pairs(4), Some(Fault::Shape));
    let refs = |first| {
        fault(|p| {
            p.refs = vec![0, 4, 0, 4, 6];
            p.nodes[4] = Node::leaf(first, 2);
            p.nodes[5] = Node::leaf(4, 1);
        })
    };
    assert_eq!(refs(2), None);
    assert_eq!(refs(0), Some(Fault::Shape));
}

#[test]
fn any_other_word_in_any_place_is_found() {
    let Parts { header, nodes, refs } = good();
    let words: Vec<u32> = [
        &bytemuck::cast::<_, [u32; 16]>(header)[..],
        bytemuck::cast_slice(&nodes),
        bytemuck::cast_slice(&refs),
    ]
    .concat();
    for place in 0..words.len() {
        for bit in 0..32 {
            let mut words = words.clone();
            words[place] ^= 1 << bit;
            let header = bytemuck::cast(<[u32; 16]>::try_from(&words[..16]).unwrap());
            let (nodes, refs) = words[16..].split_at(2 * nodes.len());
            let nodes: &[Node] = bytemuck::cast_slice(nodes);
            assert!(
                TreeView { header: &header, nodes, refs }.validate().is_err(),
                "bit {bit} of word {place}"
            );
        }
    }
}

#[test]
fn planes_must_cut_their_boxes() {
    assert_eq!(fault(|p| p.nodes[0] = Node::inner(0, 1.5, 2)), Some(Fault::Split(0)));
    assert_eq!(fault(|p| p.nodes[3] = Node::inner(0, 0.25, 4)), Some(Fault::Split(3)));
    assert_eq!(fault(|p| p.nodes[3] = Node::inner(1, f32::NAN, 4)), Some(Fault::Split(3)));
}

#[test]
fn references_must_rise_and_exist() {
    assert_eq!(fault(|p| p.nodes[5] = Node::leaf(3, 3)), Some(Fault::Leaf(5)));
    assert_eq!(fault(|p| p.nodes[5] = Node::leaf(u32::MAX, 3)), Some(Fault::Leaf(5)));
    assert_eq!(fault(|p| p.refs[1] = 0), Some(Fault::Reference(2)));
    assert_eq!(fault(|p| p.refs[4] = 7), Some(Fault::Reference(5)));
    assert_eq!(fault(|p| p.nodes[5] = Node::leaf(2, 2)), Some(Fault::Shape));
}

#[test]
fn nodes_come_apart_as_they_were_put_together() {
    let inner = Node::inner(2, -1.5, 40);
    assert_eq!(inner.content(), Content::Inner { axis: 2, split: -1.5, below: 40 });
    let leaf = Node::leaf(u32::MAX, (1 << 30) - 1);
    assert_eq!(leaf.content(), Content::Leaf { first: u32::MAX, count: (1 << 30) - 1 });
    for node in [inner, leaf] {
        let (word0, word1) = node.words();
        assert_eq!(Node::from_words(word0, word1), node);
    }
}
