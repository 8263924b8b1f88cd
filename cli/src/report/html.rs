//! Pieces of the page. Whatever comes from outside passes through [`escape`] here.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::plots;

const STYLE: &str = include_str!("style.css");

/// Text for HTML, inside attributes, too.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            other => out.push(other),
        }
    }
    out
}

/// An element with nothing but text in it.
pub fn text(tag: &str, text: &str) -> String {
    format!("<{tag}>{}</{tag}>\n", escape(text))
}

/// The whole document; `body` is HTML.
pub fn page(title: &str, body: &str) -> String {
    let title = escape(title);
    let colours = plots::colour_rules();
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>{title}</title>\n<style>\n{STYLE}{colours}</style>\n\
         <body>\n{body}</body>\n</html>\n"
    )
}

/// A chapter: what it is, in words, and its `body` (HTML).
pub fn section(title: &str, lead: &str, body: &str) -> String {
    format!("<section>\n{}{}{body}</section>\n", text("h2", title), text("p", lead))
}

/// Cards beside each other where there is room; each is HTML.
pub fn row(class: &str, cards: &[String]) -> String {
    format!("<div class=\"row {class}\">\n{}</div>\n", cards.concat())
}

/// A drawing (HTML) with a caption and its keys: class of the colour, and what has it.
pub fn figure(drawing: &str, caption: &str, keys: &[(&str, &str)]) -> String {
    let mut legend = String::new();
    for (class, meaning) in keys {
        let _ = write!(legend, "<span class=\"key {class}\">{}</span> ", escape(meaning));
    }
    let label = escape(caption);
    format!(
        "<figure class=\"card\">\n<figcaption>{label}</figcaption>\n<div class=\"keys\">{legend}</div>\n\
         {drawing}</figure>\n"
    )
}

/// Drawings (HTML) beside each other, each with what it is.
pub fn strip(drawings: &[(String, String)]) -> String {
    let part = |(drawing, name): &(String, String)| format!("<div>{drawing}<small>{}</small></div>\n", escape(name));
    format!("<div class=\"strip\">\n{}</div>\n", drawings.iter().map(part).collect::<String>())
}

/// The same of a film's frames, [`FRAMES`](super::pictures::FRAMES) in a row.
pub fn frames(drawings: &[(String, String)]) -> String {
    strip(drawings).replacen("class=\"strip\"", "class=\"strip frames\"", 1)
}

/// What is folded under `summary` (text): HTML.
pub fn folded(summary: &str, body: &str) -> String {
    format!("<details class=\"card\">\n<summary>{}</summary>\n{body}</details>\n", escape(summary))
}

/// A cell of a table.
pub struct Cell {
    value: String,
    /// What stands behind it: an uncertainty.
    sigma: String,
    class: Option<&'static str>,
}

impl Cell {
    /// Plain.
    pub fn text(value: String) -> Self {
        Self { value, sigma: String::new(), class: None }
    }

    /// A number to be read as a fact.
    pub fn bold(value: String, sigma: String) -> Self {
        Self { value, sigma, class: Some("precise") }
    }

    /// A number that is known less well.
    pub fn vague(value: String, sigma: String) -> Self {
        Self { value, sigma, class: Some("vague") }
    }

    fn html(&self) -> String {
        let (value, sigma) = (escape(&self.value), escape(&self.sigma));
        let sigma = if sigma.is_empty() { sigma } else { format!(" <small>{sigma}</small>") };
        match self.class {
            None => value + &sigma,
            Some("precise") => format!("<strong>{value}</strong>{sigma}"),
            Some(class) => format!("<span class=\"{class}\">{value}{sigma}</span>"),
        }
    }
}

/// A table; the first cell of a row is its name.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let rows: Vec<Vec<Cell>> = rows.iter().map(|row| row.iter().cloned().map(Cell::text).collect()).collect();
    table_of("card scroll", head, &rows)
}

/// The same of cells that are more than text, and wrap.
pub fn cells(head: &[&str], rows: &[Vec<Cell>]) -> String {
    table_of("card scroll wraps", head, rows)
}

fn table_of(class: &str, head: &[&str], rows: &[Vec<Cell>]) -> String {
    let mut out = format!("<div class=\"{class}\" tabindex=\"0\">\n<table>\n<thead><tr>");
    for name in head {
        let _ = write!(out, "<th scope=\"col\">{}</th>", escape(name));
    }
    out.push_str("</tr></thead>\n<tbody>\n");
    for row in rows {
        out.push_str("<tr>");
        for (index, cell) in row.iter().enumerate() {
            let cell = cell.html();
            let _ = match index {
                0 => write!(out, "<th scope=\"row\">{cell}</th>"),
                _ => write!(out, "<td>{cell}</td>"),
            };
        }
        out.push_str("</tr>\n");
    }
    out + "</tbody>\n</table>\n</div>\n"
}

/// Big numbers: what each is, the number, and what to know of it.
pub fn tiles(tiles: &[[String; 3]]) -> String {
    let tile = |[name, value, note]: &[String; 3]| {
        let [name, value, note] = [name, value, note].map(|words| escape(words));
        format!("<div class=\"card tile\"><dt>{name}</dt><dd>{value}</dd><dd class=\"note\">{note}</dd></div>\n")
    };
    format!("<dl class=\"row tiles\">\n{}</dl>\n", tiles.iter().map(tile).collect::<String>())
}

/// The address of a PNG that is inside the page.
pub fn data_uri(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", STANDARD.encode(png))
}
