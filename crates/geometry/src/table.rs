//! Tables of numbers in text: CSV of `,`, `;` or tabs, with or without quotes, byte order mark and carriage returns.

use crate::error::{Error, Result};

/// A table with a line of names above it.
#[derive(Debug)]
pub struct Table {
    what: String,
    columns: Vec<String>,
    /// The rows.
    pub rows: Vec<Row>,
}

/// A row.
#[derive(Debug)]
pub struct Row {
    /// File and line.
    pub what: String,
    cells: Vec<String>,
}

/// A column that is there.
#[derive(Debug, Clone, Copy)]
pub struct Column<'a> {
    index: usize,
    name: &'a str,
}

impl<'a> Column<'a> {
    /// As it was asked for.
    pub fn name(&self) -> &'a str {
        self.name
    }
}

impl Table {
    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] for a file that is no text, else as [`Self::from_text`].
    pub fn from_file(path: &std::path::Path) -> Result<Self> {
        Self::from_text(&Self::text_of(path)?, &path.display().to_string())
    }

    /// The text of a file.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] for a file that is no text.
    pub fn text_of(path: &std::path::Path) -> Result<String> {
        let bytes = crate::files::read(path)?;
        let text = String::from_utf8(bytes).map_err(|error| format!("is not a text file ({})", error.utf8_error()));
        text.map_err(Error::format(&path.display().to_string()))
    }

    /// Reads a text that has no line of names, if its first line holds numbers alone, as many as there are names.
    pub fn without_names(text: &str, what: &str, names: &[&str]) -> Option<Self> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let rows = records(text, what, 1).ok()?;
        let first = rows.first()?;
        let numbers = first.cells.iter().all(|cell| cell.parse::<f64>().is_ok());
        let columns = names.iter().map(|name| plain(name)).collect();
        (numbers && first.cells.len() == names.len()).then(|| Self { what: what.into(), columns, rows })
    }

    /// Reads the text of a file; `what` names it in errors. The first line may be separated otherwise than the others.
    ///
    /// # Errors
    /// [`Error::Format`] for an empty text.
    pub fn from_text(text: &str, what: &str) -> Result<Self> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let blank = text.len() - text.trim_start().len();
        let begin = text[..blank].rfind('\n').map_or(0, |at| at + 1);
        let end = text[blank..].find('\n').map_or(text.len(), |at| blank + at + 1);
        let lines = |text: &str| text.matches('\n').count();
        let header = records(&text[begin..end], what, 1 + lines(&text[..begin]))?;
        let Some(header) = header.first() else {
            return Err(Error::Format { what: what.into(), message: "is empty".into() });
        };
        let columns = header.cells.iter().map(|name| plain(name)).collect();
        Ok(Self { what: what.into(), columns, rows: records(&text[end..], what, 1 + lines(&text[..end]))? })
    }

    /// The column of that name (case, spaces and underscores are all the same).
    ///
    /// # Errors
    /// [`Error::Format`] where there is none.
    pub fn column<'a>(&self, name: &'a str) -> Result<Column<'a>> {
        let index = self.columns.iter().position(|found| *found == plain(name)).ok_or_else(|| {
            let found: Vec<&str> = self.columns.iter().map(String::as_str).take(20).collect();
            let message = format!("no column `{name}` in the first line; it has {}", found.join(", "));
            Error::Format { what: format!("{}:1", self.what), message }
        })?;
        Ok(Column { index, name })
    }

    /// The column of that name, if it is there.
    pub fn column_if_any<'a>(&self, name: &'a str) -> Option<Column<'a>> {
        self.column(name).ok()
    }

    /// The column that has one of these names, if it is there.
    pub fn column_of<'a>(&self, names: &[&'a str]) -> Option<Column<'a>> {
        names.iter().find_map(|name| self.column_if_any(name))
    }

    /// The columns of those names.
    ///
    /// # Errors
    /// As [`Self::column`].
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
                    format!("has {} cells, but `{}` is cell {}", self.cells.len(), column.name, column.index + 1);
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

    /// The number.
    ///
    /// # Errors
    /// [`Error::Value`] where the cell is empty or holds no finite number.
    pub fn number(&self, column: Column<'_>) -> Result<f64> {
        let missing = || Error::value(&self.what, column.name, "is missing");
        self.number_if_any(column)?.ok_or_else(missing)
    }

    /// The numbers.
    ///
    /// # Errors
    /// As [`Self::number`].
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

/// The rows of a text that begins at line `first` of the file; blank ones are left out. Where `;` separates, a `,` in a
/// number is its point.
fn records(text: &str, what: &str, first: usize) -> Result<Vec<Row>> {
    let separator = separator(text.trim_start().lines().next().unwrap_or_default());
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .delimiter(separator)
        .from_reader(text.as_bytes());
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(Error::format(what))?;
        if record.iter().all(str::is_empty) && record.len() < 2 {
            continue;
        }
        let cell = |cell: &str| if separator == b';' { cell.replace(',', ".") } else { cell.to_string() };
        let line = first + record.position().map_or(0, |start| lines_before(text, start));
        rows.push(Row { what: format!("{what}:{line}"), cells: record.iter().map(cell).collect() });
    }
    Ok(rows)
}

/// Lines before a record's first: the reader counts blank lines before it as its own.
fn lines_before(text: &str, start: &csv::Position) -> usize {
    let rest = text.get(start.byte() as usize..).unwrap_or_default();
    let blank = &rest[..rest.len() - rest.trim_start_matches(['\r', '\n']).len()];
    start.line() as usize - 1 + blank.matches('\n').count()
}

/// What separates the cells of a line, quoted text aside.
fn separator(line: &str) -> u8 {
    let has = |separator: char| line.split('"').step_by(2).any(|bare| bare.contains(separator));
    if has(';') {
        b';'
    } else if has(',') || !has('\t') {
        b','
    } else {
        b'\t'
    }
}

/// A name without case, spaces and underscores.
fn plain(name: &str) -> String {
    name.chars().filter(|c| !c.is_whitespace() && *c != '_').flat_map(char::to_lowercase).collect()
}
