//! YAML, JSON, OpenCV's XML and NumPy's `.npz` as one tree, and the matrices in it.

use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use gravisight::internal::read_text;
use roxmltree::{Document, Node};
use serde_json::{Map, Value, json};

use crate::import::npz;

/// How deep elements of OpenCV's XML lie in each other that are read.
const DEEPEST: usize = 16;

/// A matrix of numbers, row by row.
pub struct Array {
    /// How many rows; of a list of matrices, how many of these.
    pub rows: usize,
    pub values: Vec<f64>,
}

/// The tree of the file at `path`.
pub fn read(path: &Path) -> Result<Value> {
    let name = || path.display().to_string();
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default().to_lowercase();
    if extension == "npz" {
        let arrays = npz::arrays(path)?.into_iter().map(|(name, array)| {
            let value = match array {
                Ok(npz::Array { shape, values }) => {
                    json!({"rows": shape.first().copied().unwrap_or(1), "data": values})
                }
                Err(refused) => Value::String(refused),
            };
            (name, value)
        });
        return Ok(Value::Object(arrays.collect()));
    }
    let text = read_text(path)?;
    match extension.as_str() {
        "xml" => of_xml(&Document::parse(&text).with_context(name)?).with_context(name),
        "json" => serde_json::from_str(&text).with_context(name),
        _ => serde_saphyr::from_str(&text).map_err(|error| anyhow::anyhow!("{}: {error}", path.display())),
    }
}

fn of_xml(document: &Document) -> Result<Value> {
    let root = document.root_element();
    ensure!(
        root.has_tag_name("opencv_storage"),
        "is XML, but neither OpenCV's (<opencv_storage>) nor of Tsai's model (<Geometry>, <Intrinsic>)"
    );
    Ok(of_node(&root, DEEPEST))
}

/// The tree below a node, to a depth.
fn of_node(node: &Node, depth: usize) -> Value {
    if depth == 0 {
        return Value::Null;
    }
    let children: Map<String, Value> = node
        .children()
        .filter(Node::is_element)
        .map(|child| (child.tag_name().name().into(), of_node(&child, depth - 1)))
        .collect();
    if !children.is_empty() {
        return Value::Object(children);
    }
    let text = node.text().unwrap_or_default().trim();
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    match numbers.as_deref() {
        Some([]) | None => Value::String(text.trim_matches('"').into()),
        Some([number]) => json!(number),
        Some(numbers) => json!(numbers),
    }
}

/// A field under any of some names, which are told apart by letters and digits alone; and its name in the file.
pub fn field<'a>(tree: &'a Value, names: &[&str]) -> Option<(&'a str, &'a Value)> {
    let plain = |name: &str| name.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_lowercase();
    let fields = tree.as_object()?;
    let (name, value) = names.iter().find_map(|wanted| fields.iter().find(|(name, _)| plain(name) == *wanted))?;
    Some((name, value))
}

/// The matrix under any of some names.
pub fn array(tree: &Value, names: &[&str]) -> Result<Option<Array>> {
    let Some((name, value)) = field(tree, names) else { return Ok(None) };
    let read = || {
        if let Value::String(text) = value {
            bail!("is not a matrix: {text:.80}");
        }
        let data = value.get("data").unwrap_or(value);
        let mut values = Vec::new();
        flatten(data, &mut values)?;
        let rows = value.get("rows").and_then(Value::as_f64).map(|rows| rows as usize);
        let rows = rows.or(data.as_array().map(Vec::len)).unwrap_or(1);
        ensure!(
            rows > 0 && !values.is_empty() && values.len().is_multiple_of(rows),
            "has {} numbers, which do not fill {rows} rows",
            values.len()
        );
        Ok(Array { rows, values })
    };
    read().with_context(|| format!("`{name}`")).map(Some)
}

fn flatten(value: &Value, into: &mut Vec<f64>) -> Result<()> {
    match value {
        Value::Array(values) => values.iter().try_for_each(|value| flatten(value, into)),
        _ => {
            let number = value.as_f64().filter(|number| number.is_finite());
            into.push(number.with_context(|| format!("holds {value:.40}, which is not a number"))?);
            Ok(())
        }
    }
}

/// A whole number under any of some names.
pub fn whole(tree: &Value, names: &[&str]) -> Option<u32> {
    let number = field(tree, names)?.1.as_f64()?;
    (number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&number)).then_some(number as u32)
}
