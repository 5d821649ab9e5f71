//! NPY files, as `numpy.save` writes them and `numpy.load` reads them.

use anyhow::{Context as _, bail, ensure};
use npyz::{AutoSerialize, Deserialize, NpyFile, NpyReader, Order, WriteOptions, WriterBuilder as _};
use std::{
    io::{self, Write},
    path::Path,
};

/// Whether a file is named as one.
pub(super) fn is_named(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npy"))
}

/// Rows of so many numbers, of one of two types.
pub(super) enum Rows<const WIDTH: usize> {
    Narrow(Vec<[f32; WIDTH]>),
    Wide(Vec<[f64; WIDTH]>),
}

const NO_ARRAY: &str = "this is no NPY array; write it by numpy.save";

/// The rows of an array of `what`.
pub(super) fn rows<const WIDTH: usize>(bytes: &[u8], what: &str) -> anyhow::Result<Rows<WIDTH>> {
    ensure!(
        is_plain(header(bytes).context(NO_ARRAY)?),
        "its header is not that of an array of plain numbers; write {what} alone by numpy.save"
    );
    let file = NpyFile::new(bytes).context(NO_ARRAY)?;
    let (shape, by_column) = (file.shape(), file.order() == Order::Fortran);
    ensure!(
        shape.len() == 2 && shape[1] == WIDTH as u64,
        "its shape is {shape:?}; {what} are an array of N x {WIDTH} numbers"
    );
    // npyz multiplies without a look: a shape of 2^61 x 8 would be of no numbers.
    ensure!(
        shape[0] <= bytes.len() as u64,
        "it does not hold the {} {what} that it promises; write it again by numpy.save",
        shape[0]
    );
    // Only a number type can tell whether it is the file's.
    match file.try_data::<f64>() {
        Ok(data) => all(data, by_column, what).map(Rows::Wide),
        Err(file) => match file.try_data::<f32>() {
            Ok(data) => all(data, by_column, what).map(Rows::Narrow),
            Err(_) => {
                bail!("its numbers are neither f32 nor f64; convert it, in numpy by {what}.astype(float)")
            }
        },
    }
}

/// The text that tells what an array is of.
fn header(bytes: &[u8]) -> Option<&[u8]> {
    let [version, _, rest @ ..] = bytes.strip_prefix(b"\x93NUMPY")? else { return None };
    let (length, text) = match (version, rest) {
        (1, [a, b, text @ ..]) => (u32::from_le_bytes([*a, *b, 0, 0]), text),
        (2.., [a, b, c, d, text @ ..]) => (u32::from_le_bytes([*a, *b, *c, *d]), text),
        _ => return None,
    };
    text.get(..length as usize)
}

/// Whether npyz can read a header in little time and on a small stack: the time doubles with every bracket in another,
/// and grows with the square of a number's digits. An array of numbers has a dictionary with one tuple, and numpy too
/// refuses longer headers.
fn is_plain(header: &[u8]) -> bool {
    let count = |bracket: u8| header.iter().filter(|&&b| b == bracket).count();
    header.len() <= 10_000 && count(b'[') == 0 && count(b'{') <= 1 && count(b'(') <= 1
}

fn all<T: Deserialize + Copy, const WIDTH: usize>(
    data: NpyReader<T, &[u8]>,
    by_column: bool,
    what: &str,
) -> anyhow::Result<Vec<[T; WIDTH]>> {
    let promised = data.shape()[0];
    let numbers: io::Result<Vec<T>> = data.collect();
    let numbers =
        numbers.with_context(|| format!("it does not hold the {promised} {what} that it promises"))?;
    let count = numbers.len() / WIDTH;
    let at = |row, column| if by_column { column * count + row } else { WIDTH * row + column };
    Ok((0..count).map(|row| std::array::from_fn(|column| numbers[at(row, column)])).collect())
}

/// Writes an array of that shape; rows follow each other.
pub(super) fn write<T: AutoSerialize>(
    file: &mut dyn Write,
    shape: &[usize],
    numbers: impl IntoIterator<Item = T>,
) -> io::Result<()> {
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    let mut array = WriteOptions::new().default_dtype().shape(&shape).writer(file).begin_nd()?;
    array.extend(numbers)?;
    array.finish()
}
