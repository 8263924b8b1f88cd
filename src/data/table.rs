//! Tables of numbers in text: CSV of `,` and `;`, with or without byte order mark and carriage returns.

use std::path::Path;

use super::pictures::read_text;
use crate::error::{Error, Result};

/// A table with a line of names above it.
#[derive(Debug)]
pub(super) struct Table {
    what: String,
    columns: Vec<String>,
    /// The rows.
    pub rows: Vec<Row>,
}

/// A row.
#[derive(Debug)]
pub(super) struct Row {
    /// File and line.
    pub what: String,
    cells: Vec<String>,
}

/// A column that is there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column<'a> {
    index: usize,
    name: &'a str,
}

impl Table {
    pub fn from_file(path: &Path) -> Result<Self> {
        Self::from_text(&read_text(path)?, &path.display().to_string())
    }

    pub fn from_text(text: &str, what: &str) -> Result<Self> {
        let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let Some((_, header)) = lines.next() else {
            return Err(Error::Format { what: what.into(), message: "is empty".into() });
        };
        let columns = cells(header).iter().map(|name| plain(name)).collect();
        let row = |(index, line)| Row { what: format!("{what}:{}", index + 1), cells: cells(line) };
        Ok(Self { what: what.into(), columns, rows: lines.map(row).collect() })
    }

    /// The column of that name (case, spaces and underscores are all the same).
    pub fn column<'a>(&self, name: &'a str) -> Result<Column<'a>> {
        let index = self.columns.iter().position(|found| *found == plain(name)).ok_or_else(|| {
            let found: Vec<&str> = self.columns.iter().map(String::as_str).take(20).collect();
            let message = format!("no column `{name}` in the first line; it has {}", found.join(", "));
            Error::Format { what: format!("{}:1", self.what), message }
        })?;
        Ok(Column { index, name })
    }

    pub fn columns<'a, const N: usize>(&self, names: [&'a str; N]) -> Result<[Column<'a>; N]> {
        let found = names.iter().map(|name| self.column(name)).collect::<Result<Vec<_>>>()?;
        found.try_into().map_err(|_| Error::Format { what: self.what.clone(), message: "columns are missing".into() })
    }
}

impl Row {
    /// The cell as written; none where it is empty.
    pub fn text(&self, column: Column<'_>) -> Result<Option<&str>> {
        match self.cells.get(column.index) {
            Some(cell) => Ok(Some(cell.as_str()).filter(|cell| !cell.is_empty())),
            None => {
                let message =
                    format!("has {} cells, `{}` would be cell {}", self.cells.len(), column.name, column.index + 1);
                Err(Error::Format { what: self.what.clone(), message })
            }
        }
    }

    /// The number; none where the cell is empty.
    pub fn number_if_any(&self, column: Column<'_>) -> Result<Option<f64>> {
        let Some(text) = self.text(column)? else { return Ok(None) };
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Some(value)),
            _ => Err(Error::value(&self.what, column.name, format!("must be a finite number, not `{text}`"))),
        }
    }

    pub fn number(&self, column: Column<'_>) -> Result<f64> {
        let missing = || Error::value(&self.what, column.name, "is missing");
        self.number_if_any(column)?.ok_or_else(missing)
    }

    pub fn numbers<const N: usize>(&self, columns: [Column<'_>; N]) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for (number, column) in numbers.iter_mut().zip(columns) {
            *number = self.number(column)?;
        }
        Ok(numbers)
    }

    /// A whole number that is not negative (`3` or `3.0`).
    pub fn count(&self, column: Column<'_>) -> Result<u64> {
        let number = self.number(column)?;
        match number >= 0.0 && number.fract() == 0.0 && number < 2_f64.powi(53) {
            true => Ok(number as u64),
            false => Err(Error::value(&self.what, column.name, format!("must be a whole number, not {number}"))),
        }
    }

    /// `true`, `false` or a number, of which 0 is false.
    pub fn flag(&self, column: Column<'_>) -> Result<bool> {
        match self.text(column)?.map(str::to_ascii_lowercase).as_deref() {
            Some("true") => Ok(true),
            Some("false") => Ok(false),
            _ => Ok(self.number(column)? != 0.0),
        }
    }
}

/// The cells of a line. Where it has a `;`, that separates, and a `,` in a number is its point.
fn cells(line: &str) -> Vec<String> {
    let bare = |cell: &str| cell.trim().trim_matches('"').trim().to_string();
    match line.contains(';') {
        true => line.split(';').map(|cell| bare(cell).replace(',', ".")).collect(),
        false => line.split([',', '\t']).map(bare).collect(),
    }
}

/// A name without case, spaces and underscores.
fn plain(name: &str) -> String {
    name.chars().filter(|c| !c.is_whitespace() && *c != '_').flat_map(char::to_lowercase).collect()
}
