//! Files and folders: texts, pictures by number, names.

use gravisight::{Error, Result};
use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Folders in folders that are looked into.
const MAX_DEPTH: usize = 8;
/// Extensions of pictures.
pub(super) const PICTURES: [&str; 4] = ["png", "jpg", "jpeg", "webp"];
/// Most numbers that are told to be left out in one place.
const MOST_LEFT_OUT: u64 = 1000;

/// The text of a UTF-8 file, without a byte order mark.
pub(super) fn read_text(path: &Path) -> Result<String> {
    let text = gravisight::internal::read_text(path)?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_string).unwrap_or(text))
}

/// The extension for a picture's bytes.
pub(super) fn format_of(bytes: &[u8]) -> Option<&'static str> {
    match image::guess_format(bytes).ok()? {
        image::ImageFormat::Png => Some("png"),
        image::ImageFormat::Jpeg => Some("jpg"),
        image::ImageFormat::WebP => Some("webp"),
        _ => None,
    }
}

/// Whether `path` has one of the extensions, in any case.
pub(super) fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    extensions.iter().any(|known| known.eq_ignore_ascii_case(extension))
}

/// Whether a path is named as a picture.
pub fn is_picture(path: &Path) -> bool {
    has_extension(path, &PICTURES)
}

/// What is in a folder, in natural order.
pub(super) fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect());
    let mut entries: Vec<PathBuf> = entries.map_err(Error::io(folder))?;
    entries.sort_by(|one, other| natural(&one.to_string_lossy(), &other.to_string_lossy()));
    Ok(entries)
}

/// The pictures of a folder, in natural order: `9.png` before `10.png`.
///
/// # Errors
/// [`Error::Io`]; [`Error::Data`] where there are none.
pub fn pictures_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut pictures = entries(folder)?;
    pictures.retain(|path| is_picture(path) && path.is_file());
    match pictures.is_empty() {
        true => Err(Error::Data {
            what: folder.display().to_string(),
            reason: "holds no PNG, JPEG or WebP pictures".into(),
        }),
        false => Ok(pictures),
    }
}

/// Numbers that are left out between pictures whose names end with ascending numbers; none where they do not.
pub fn left_out(pictures: &[PathBuf]) -> Vec<u64> {
    let number = |path: &PathBuf| last_number(&path.file_stem()?.to_string_lossy());
    let Some(numbers) = pictures.iter().map(number).collect::<Option<Vec<u64>>>() else { return vec![] };
    let rising = numbers.windows(2).all(|pair| pair[0] < pair[1]);
    let between = |pair: &[u64]| pair[0] + 1..pair[1].min(pair[0] + MOST_LEFT_OUT);
    if rising { numbers.windows(2).flat_map(between).collect() } else { vec![] }
}

/// The files below `root` that `wanted` wants, in natural order.
pub(super) fn files_below(root: &Path, wanted: &dyn Fn(&Path) -> bool) -> Result<Vec<PathBuf>> {
    fn look(folder: &Path, depth: usize, wanted: &dyn Fn(&Path) -> bool, found: &mut Vec<PathBuf>) -> Result<()> {
        for entry in entries(folder)? {
            // Most files are pictures, and what they are need not be asked.
            if wanted(&entry) && entry.is_file() {
                found.push(entry);
            } else if depth < MAX_DEPTH && !has_extension(&entry, &PICTURES) && entry.is_dir() {
                look(&entry, depth + 1, wanted, found)?;
            }
        }
        Ok(())
    }
    let mut found = Vec::new();
    look(root, 0, wanted, &mut found)?;
    Ok(found)
}

/// The pictures of a folder by the last number in their names.
///
/// # Errors
/// [`Error::Io`]; [`Error::Data`] for two pictures of one number.
pub(super) fn by_number(folder: &Path, prefix: &str) -> Result<BTreeMap<u64, PathBuf>> {
    let mut pictures = BTreeMap::new();
    for path in entries(folder)?.into_iter().filter(|path| has_extension(path, &PICTURES)) {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let Some(number) = last_number(&stem).filter(|_| stem.starts_with(prefix)) else { continue };
        if let Some(other) = pictures.insert(number, path.clone()) {
            let reason = format!("has the same number as {}; remove one of them", other.display());
            return Err(Error::Data { what: path.display().to_string(), reason });
        }
    }
    Ok(pictures)
}

/// The pictures of the rows of a table: `prefix` and a number that counts from 0 or from 1.
///
/// # Errors
/// As [`by_number`]; [`Error::Data`] where there are more or fewer pictures than rows, or one is missing.
pub(super) fn one_a_row(folder: &Path, prefix: &str, rows: usize, table: &str) -> Result<Vec<PathBuf>> {
    let mut pictures = by_number(folder, prefix)?;
    let first = u64::from(!pictures.contains_key(&0) && pictures.contains_key(&(rows as u64)));
    let refuse = |reason: String| Error::Data { what: folder.display().to_string(), reason };
    let picture = |row: usize| {
        let number = first + row as u64;
        pictures.remove(&number).ok_or_else(|| refuse(format!("picture {number}, listed in {table}, is missing")))
    };
    let ordered = (0..rows).map(picture).collect::<Result<Vec<_>>>()?;
    match pictures.first_key_value() {
        None => Ok(ordered),
        Some((number, _)) => Err(refuse(format!("picture {number} is not listed in {table}"))),
    }
}

/// The last number in a name.
pub(super) fn last_number(name: &str) -> Option<u64> {
    let until = name.rfind(|c: char| c.is_ascii_digit())? + 1;
    let from = name[..until].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| {
        // The character before may be several bytes long.
        at + name[at..].chars().next().map_or(1, char::len_utf8)
    });
    name[from..until].parse().ok()
}

/// Frame numbers of pictures in the order of time: the last numbers in their names where they grow, else the order's.
pub(super) fn numbers_of<'a>(pictures: impl ExactSizeIterator<Item = &'a Path> + Clone) -> Vec<u64> {
    let count = pictures.len() as u64;
    let in_name = |picture: &Path| last_number(&picture.file_stem()?.to_string_lossy());
    let in_names = pictures.map(in_name).collect::<Option<Vec<u64>>>();
    let grow = |numbers: &Vec<u64>| numbers.windows(2).all(|pair| pair[0] < pair[1]);
    in_names.filter(grow).unwrap_or_else(|| (0..count).collect())
}

/// Order of names in which numbers count as such: `frame2` before `frame10`.
pub(super) fn natural(one: &str, other: &str) -> Ordering {
    let parts = |name: &str| -> Vec<(String, u64)> {
        let mut parts: Vec<(String, String)> = vec![Default::default()];
        for c in name.chars() {
            match (c.is_ascii_digit(), parts.last_mut()) {
                (true, Some((_, digits))) => digits.push(c),
                (false, Some((text, digits))) if digits.is_empty() => text.push(c),
                _ => parts.push((c.to_string(), String::new())),
            }
        }
        parts.into_iter().map(|(text, digits)| (text, digits.parse().unwrap_or(u64::MAX))).collect()
    };
    parts(one).cmp(&parts(other)).then_with(|| one.cmp(other))
}

/// A clip's name from parts of a path: letters, digits, `-`, `_` and `.` stay, a number gets four digits.
pub(super) fn id_of<'a>(parts: impl IntoIterator<Item = &'a str>) -> String {
    let clean = |part: &str| -> String {
        if let Ok(number) = part.parse::<u64>() {
            return format!("{number:04}");
        }
        let plain = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '-' };
        let part: String = part.chars().map(plain).collect();
        part.trim_start_matches('.').to_string()
    };
    let parts: Vec<String> = parts.into_iter().map(clean).filter(|part| !part.is_empty()).collect();
    if parts.is_empty() { "clip".into() } else { parts.join("/") }
}

/// The last `N` parts of a path, the first of them first.
pub(super) fn tail<const N: usize>(path: &Path) -> Option<[String; N]> {
    let parts: Vec<String> = path.iter().map(|part| part.to_string_lossy().into_owned()).collect();
    parts.get(parts.len().checked_sub(N)?..)?.to_vec().try_into().ok()
}
