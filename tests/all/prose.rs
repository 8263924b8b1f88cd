//! Plain English: sentences of at most 25 words, short table cells, and words that say what is meant. What is still longer is counted for each
//! document, and the counts may only fall.

use std::collections::BTreeMap;

/// Most words in a sentence.
const WORDS: usize = 25;
/// Most characters in a cell of a table.
const CELL: usize = 150;
/// What reads as translated: see CONTRIBUTING.md.
const NOT_USED: [&str; 9] =
    ["is said", "are said", "is told", "are told", "of which", "asked about", "'s word", "said to be", "looked at"];
/// Each document, and how many long sentences, long cells and such words it still has.
const LEFT: [(&str, [usize; 3]); 3] =
    [("models/sd-l.md", [0, 1, 0]), ("models/sd-s-1px.md", [1, 0, 0]), ("models/sd-s-future.md", [3, 0, 0])];

/// The paragraphs, list items and cells of a document, without code.
fn parts(text: &str) -> (Vec<String>, Vec<String>) {
    let (mut paragraphs, mut cells) = (vec![String::new()], vec![]);
    let mut is_code = false;
    for line in text.lines().map(str::trim) {
        if line.starts_with("```") {
            is_code = !is_code;
            paragraphs.push(String::new());
        } else if is_code || line.starts_with('#') || line.starts_with("<!--") || line.is_empty() {
            paragraphs.push(String::new());
        } else if line.starts_with('|') {
            cells.extend(line.trim_matches('|').split('|').map(|cell| without_code(cell.trim())));
        } else {
            let is_item = ["- ", "* "].iter().any(|start| line.starts_with(start))
                || line.split_once(". ").is_some_and(|(number, _)| number.parse::<u32>().is_ok());
            if is_item {
                paragraphs.push(String::new());
            }
            let paragraph = paragraphs.last_mut().unwrap();
            *paragraph += " ";
            *paragraph += line;
        }
    }
    (paragraphs.iter().map(|paragraph| without_code(paragraph.trim())).collect(), cells)
}

/// `text` with a word for each piece of code, and links as their texts.
fn without_code(text: &str) -> String {
    let pieces: Vec<String> = text
        .split('`')
        .enumerate()
        .map(|(at, part)| if at % 2 == 1 { "Code".into() } else { part.to_string() })
        .collect();
    let (mut out, text) = (String::new(), pieces.concat());
    let mut rest = text.as_str();
    while let Some((before, after)) = rest.split_once("](") {
        out += before;
        rest = after.split_once(')').map_or("", |(_, after)| after);
    }
    out + rest
}

fn sentences(paragraph: &str) -> Vec<&str> {
    let mut found = vec![];
    let mut start = 0;
    for (at, _) in paragraph.match_indices(['.', '!', '?']) {
        let after = &paragraph[at + 1..];
        let next = after.trim_start_matches([')', '*', '"', '”']).chars().collect::<Vec<_>>();
        let ends = next.first().is_none_or(|c| c.is_whitespace()) && next.get(1).is_none_or(|c| !c.is_lowercase());
        if ends {
            found.push(&paragraph[start..=at]);
            start = at + 1;
        }
    }
    found.push(&paragraph[start..]);
    found
}

/// The long sentences, the long cells, and the words that are not used, in a document.
fn offences(text: &str) -> [Vec<String>; 3] {
    let (paragraphs, cells) = parts(text);
    let is_long = |sentence: &&str| {
        sentence.split_whitespace().filter(|word| word.chars().any(char::is_alphanumeric)).count() > WORDS
    };
    let long =
        paragraphs.iter().flat_map(|paragraph| sentences(paragraph)).filter(is_long).map(|it| it.trim().to_string());
    let wide = cells.iter().filter(|cell| cell.chars().count() > CELL).cloned();
    let all = paragraphs.iter().chain(&cells);
    let words = all.flat_map(|part| {
        let part = part.to_lowercase();
        NOT_USED.iter().filter(move |words| part.contains(*words)).map(|words| (*words).to_string())
    });
    [long.collect(), wide.collect(), words.collect()]
}

/// The documents that users read. The laboratory book and the paper's tables are not among them.
fn documents() -> BTreeMap<String, String> {
    let root = crate::common::root();
    let mut names: Vec<String> =
        ["README.md", "ARCHITECTURE.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "pkg/README.md"]
            .map(String::from)
            .to_vec();
    for folder in ["docs", "models"] {
        for entry in std::fs::read_dir(root.join(folder)).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            if name.ends_with(".md") && !["experiments.md", "paper.md"].contains(&name.as_str()) {
                names.push(format!("{folder}/{name}"));
            }
        }
    }
    names.into_iter().map(|name| (name.clone(), std::fs::read_to_string(root.join(&name)).unwrap())).collect()
}

#[test]
fn documents_are_in_plain_english() {
    let left: BTreeMap<&str, [usize; 3]> = LEFT.into_iter().collect();
    let mut wrong = vec![];
    for (name, text) in documents() {
        let found = offences(&text);
        let counts = [0, 1, 2].map(|kind| found[kind].len());
        let allowed = left.get(name.as_str()).copied().unwrap_or_default();
        if counts != allowed {
            let worse: Vec<&String> =
                (0..3).filter(|&kind| counts[kind] > allowed[kind]).flat_map(|kind| &found[kind]).collect();
            wrong.push(format!("    (\"{name}\", {counts:?}), // {allowed:?} are allowed: {worse:#?}"));
        }
    }
    assert!(wrong.is_empty(), "shorten what is new, or lower the counts in LEFT to these:\n{}", wrong.join("\n"));
}

#[test]
fn long_sentences_cells_and_words_are_found() {
    let long = "word ".repeat(WORDS + 1);
    let text = format!(
        "# A title of {long}\n\n{long}.\nShort one. It is `{long}` and [a link]({long}).\n\n```\n{long}\n```\n\n| {} | b |\n\n- {long}\n- The ball is said to be found.\n",
        "c".repeat(CELL + 1)
    );
    let [sentences, cells, words] = offences(&text);
    assert_eq!((sentences.len(), cells.len()), (2, 1), "{sentences:?} {cells:?}");
    assert_eq!(words, ["is said", "said to be"]);
}
