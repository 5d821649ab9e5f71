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

/// The rows of an array of `what`.
pub(super) fn rows<const WIDTH: usize>(bytes: &[u8], what: &str) -> anyhow::Result<Rows<WIDTH>> {
    let file = NpyFile::new(bytes).context("this is no NPY array; write it by numpy.save")?;
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
