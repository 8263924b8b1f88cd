//! NumPy's `.npz`: a zip of `.npy` files, of which matrices of floats are read.
//! Format: numpy.lib.format, versions 1 to 3.

use gravisight::internal::read;
use gravisight::{Error, Result};
use std::io::{Cursor, Read as _};
use std::path::Path;

/// Largest array read, bytes: a matrix has a few hundred, and a zip can claim anything.
const MAX_BYTES: u64 = 1 << 20;
/// What a `.npy` file begins with.
const MAGIC: &[u8] = b"\x93NUMPY";

/// An array of numbers of any shape.
#[derive(Debug)]
pub(crate) struct Array {
    /// Its sides.
    pub shape: Vec<usize>,
    /// The last index runs fastest.
    pub values: Vec<f64>,
}

/// A matrix of numbers.
#[derive(Debug)]
pub(super) struct Matrix {
    /// Numbers of rows and columns.
    pub shape: [usize; 2],
    /// Row by row.
    pub values: Vec<f64>,
}

impl Matrix {
    /// The upper left `ROWS`×`COLUMNS` part of a matrix that has at least those.
    pub fn part<const ROWS: usize, const COLUMNS: usize>(&self) -> Option<[[f64; COLUMNS]; ROWS]> {
        let [rows, columns] = self.shape;
        let at = |row: usize, column: usize| self.values[row * columns + column];
        (rows >= ROWS && columns >= COLUMNS)
            .then(|| std::array::from_fn(|row| std::array::from_fn(|column| at(row, column))))
    }
}

/// The matrix `name` of the `.npz` file at `path`.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] for another file, a missing or other array; [`Error::Value`] for NaN.
pub(super) fn matrix(path: &Path, name: &str) -> Result<Matrix> {
    let bytes = read(path)?;
    let what = path.display().to_string();
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).map_err(Error::format(&what))?;
    let what = format!("{what}: {name}");
    let file = archive.by_name(&format!("{name}.npy")).map_err(Error::format(&what))?;
    let Array { shape, values } = array(file).map_err(Error::format(&what))?;
    let shape = <[usize; 2]>::try_from(shape)
        .map_err(|shape| Error::format(&what)(format!("has the shape {shape:?}; a matrix is needed")))?;
    let matrix = Matrix { shape, values };
    match matrix.values.iter().all(|value| value.is_finite()) {
        true => Ok(matrix),
        false => Err(Error::value(path.display().to_string(), name, "holds NaN or infinity")),
    }
}

/// All arrays of the `.npz` file at `path` by their names, or why one cannot be read.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] for another file.
pub(crate) fn arrays(path: &Path) -> Result<Vec<(String, std::result::Result<Array, String>)>> {
    let bytes = read(path)?;
    let what = path.display().to_string();
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).map_err(Error::format(&what))?;
    let count = archive.len();
    let read = |index: usize| {
        let file = archive.by_index(index).map_err(Error::format(&what))?;
        let name = file.name().map_err(Error::format(&what))?.trim_end_matches(".npy").to_string();
        Ok((name, array(file)))
    };
    (0..count).map(read).collect()
}

fn array(file: impl std::io::Read) -> std::result::Result<Array, String> {
    let mut bytes = Vec::new();
    file.take(MAX_BYTES).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    parse(&bytes)
}

fn parse(bytes: &[u8]) -> std::result::Result<Array, String> {
    let rest = bytes.strip_prefix(MAGIC).ok_or("is not a .npy array")?;
    let (length, rest) = match *rest {
        [1, _, a, b, ref rest @ ..] => (usize::from(u16::from_le_bytes([a, b])), rest),
        [2 | 3, _, a, b, c, d, ref rest @ ..] => (u32::from_le_bytes([a, b, c, d]) as usize, rest),
        _ => return Err("is a .npy array of an unknown version".into()),
    };
    let (header, data) = rest.split_at_checked(length).ok_or("is truncated in its header")?;
    let header = std::str::from_utf8(header).map_err(|error| error.to_string())?;
    let shape = shape(header)?;
    let count = shape.iter().try_fold(1_usize, |count, side| count.checked_mul(*side)).ok_or("is too large")?;
    let kind = entry(header, "descr").and_then(|text| text.trim_start().split(['\'', '"']).nth(1)).unwrap_or_default();
    let values =
        values(data, kind).ok_or_else(|| format!("is of type `{kind}`; float32, float64 or int64 is needed"))?;
    if values.len() < count {
        return Err(format!("is truncated: has {} of its {count} numbers", values.len()));
    }
    let by_columns = entry(header, "fortran_order").is_some_and(|text| text.trim_start().starts_with("True"));
    // Of the element that is `index`th where the last index runs fastest, its place where the first one does.
    let place = |index: usize| {
        let (mut rest, mut after, mut place) = (index, count, 0);
        for side in shape.iter().rev() {
            after /= side;
            place += (rest % side) * after;
            rest /= side;
        }
        place
    };
    let at = |index: usize| if by_columns { values[place(index)] } else { values[index] };
    let values = (0..count).map(at).collect();
    Ok(Array { shape, values })
}

/// What follows `'key':` in the header, a Python dictionary.
fn entry<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let after = header.split_once(&format!("'{key}'"))?.1;
    after.trim_start().strip_prefix(':')
}

fn shape(header: &str) -> std::result::Result<Vec<usize>, String> {
    let text = entry(header, "shape").and_then(|text| text.split_once('(')?.1.split_once(')')).ok_or("has no shape")?.0;
    let sides = text.split(',').map(str::trim).filter(|side| !side.is_empty());
    sides.map(str::parse).collect::<std::result::Result<_, _>>().map_err(|_| "has no shape".into())
}

fn values(data: &[u8], kind: &str) -> Option<Vec<f64>> {
    let doubles = |number: fn([u8; 8]) -> f64| data.as_chunks().0.iter().map(|bytes| number(*bytes)).collect();
    let floats = |number: fn([u8; 4]) -> f32| data.as_chunks().0.iter().map(|bytes| number(*bytes).into()).collect();
    match kind {
        "<f8" => Some(doubles(f64::from_le_bytes)),
        ">f8" => Some(doubles(f64::from_be_bytes)),
        "<f4" => Some(floats(f32::from_le_bytes)),
        ">f4" => Some(floats(f32::from_be_bytes)),
        "<i8" => Some(doubles(|bytes| i64::from_le_bytes(bytes) as f64)),
        _ => None,
    }
}
