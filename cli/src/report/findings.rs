//! What people are told first: the verdict, why something is not explained, flights and contacts with their uncertainty, the place
//! from above.

use std::fmt::Write as _;

use gravisight::Findings;
use gravisight::findings::{ContactFinding, Measured, Plan, Spot};

use super::html::{self, Cell};

/// Standard deviations that the ellipse of a bounce is drawn at.
const DRAWN_SIGMAS: f64 = 2.0;
/// Height of the numbers in the plan, and radius of a bounce's dot, as fractions of its longer side.
const TEXT: f64 = 0.032;
const DOT: f64 = 0.006;
/// Which numbers are bold.
const RULE: &str = "Bold: positions known to within 0.3 m and a tenth of their distance from the camera; speeds and spins known to \
                    within a tenth. Grey: known less well. ± is 1 σ.";

/// The page's head: what was looked at, and what came out.
pub fn head(name: &str, findings: &Findings) -> String {
    format!(
        "<header>\n{}<p class=\"verdict\">{}</p>\n</header>\n",
        html::text("h1", name),
        html::escape(&findings.headline)
    )
}

/// Why something is not explained, folded; then what else is to be known.
pub fn remarks(findings: &Findings) -> String {
    let mut body = String::new();
    if !findings.reasons.is_empty() {
        let mut list = String::from("<dl class=\"reasons\">\n");
        for reason in &findings.reasons {
            let _ = writeln!(list, "<dt>{}</dt><dd>{}</dd>", html::escape(&reason.what), html::escape(&reason.why));
        }
        list += "</dl>\n";
        let unknown = findings.contacts.iter().filter(|contact| contact.place.is_none());
        let unknown: Vec<String> =
            unknown.map(|contact| format!("{} at {:.2} s", contact.what, contact.time)).collect();
        if !unknown.is_empty() {
            let what = format!("Doubtful, position unknown: {}.", unknown.join(", "));
            list += &html::text("p", &what);
        }
        body += &html::folded("What is not explained, and why", &list);
    }
    if !findings.notes.is_empty() {
        let notes: String = findings.notes.iter().map(|note| html::text("li", note)).collect();
        body += &format!("<ul class=\"notes\">\n{notes}</ul>\n");
    }
    body
}

/// Flights that are explained; nothing where none is.
pub fn flights(findings: &Findings) -> String {
    let mut body = String::new();
    let flights = findings.flights.iter().enumerate().filter(|(_, flight)| flight.explained);
    let rows: Vec<Vec<Cell>> = flights
        .map(|(index, flight)| {
            vec![
                Cell::text((index + 1).to_string()),
                Cell::text(flight.when.clone()),
                measured(flight.speed.as_ref()),
                flight.spin.as_ref().map_or_else(|| Cell::text(String::new()), |spin| measured(Some(spin))),
            ]
        })
        .collect();
    // Said once, where the first such numbers are.
    let rule = if contacts(findings).is_empty() { RULE } else { "" };
    if !rows.is_empty() {
        let table = html::cells(&["Flight", "when", "initial speed", "spin"], &rows);
        body += &html::section(
            "Flights",
            format!("Each flight lasts from hit to hit and may contain bounces. {rule}").trim_end(),
            &table,
        );
    }
    body
}

/// Bounces and hits of which something is known, and where they were seen from above; nothing where there are none.
pub fn contacts(findings: &Findings) -> String {
    let known: Vec<&ContactFinding> = findings.contacts.iter().filter(|contact| contact.place.is_some()).collect();
    let mut cards: Vec<String> = plan(findings).into_iter().collect();
    if !known.is_empty() {
        let lined = known.iter().any(|contact| contact.within_lines.is_some());
        let row = |contact: &&ContactFinding| {
            let name = contact.bounce.map_or(String::new(), |number| format!(" {number}"));
            let what = match contact.what.split_once(' ') {
                Some((first, rest)) => format!("{first}{name} {rest}"),
                None => contact.what.clone(),
            };
            let mut row = vec![
                Cell::text(what),
                Cell::text(format!("{:.2}\u{a0}s", contact.time)),
                measured(contact.place.as_ref()),
                Cell::text(contact.speed.map_or(String::new(), |speed| format!("{speed:.1}\u{a0}m/s"))),
            ];
            if lined {
                let within = contact.within_lines.map_or(String::new(), |within| format!("{:.0} %", 100.0 * within));
                row.push(Cell::text(within));
            }
            row
        };
        let rows: Vec<Vec<Cell>> = known.iter().map(row).collect();
        let head = ["What", "when", "where", "impact speed", "within the lines"];
        let table = html::cells(&head[..if lined { 5 } else { 4 }], &rows);
        cards.push(table);
    }
    if cards.is_empty() {
        return String::new();
    }
    let lead = format!(
        "Bounces are off surfaces of the scene; hits are by anything else. Top view: x to the right, y up. {RULE}"
    );
    html::section("Bounces and hits", &lead, &html::row("contacts", &cards))
}

fn measured(number: Option<&Measured>) -> Cell {
    // A number stays in a line with its unit, a coordinate with its axis.
    let unbroken = |value: &str| {
        let axes = ["x ", "y ", "z "]
            .iter()
            .fold(value.to_string(), |value, axis| value.replace(axis, &axis.replace(' ', "\u{a0}")));
        axes.replace(" m", "\u{a0}m").replace(" rev", "\u{a0}rev")
    };
    number.map_or_else(
        || Cell::vague("not known".into(), String::new()),
        |Measured { value, sigma, precise, .. }| match precise {
            true => Cell::bold(unbroken(value), format!("± {sigma}")),
            false => Cell::vague(unbroken(value), format!("± {sigma}")),
        },
    )
}

/// The place from above with its bounces; none where no bounce is known.
fn plan(findings: &Findings) -> Option<String> {
    let plan = findings.plan.as_ref().filter(|plan| !plan.bounces.is_empty())?;
    let caption = "Bounces by number; the ellipse contains the bounce with a probability of 86 % (2 σ)";
    Some(html::figure(&drawing(plan), caption, &[]))
}

/// A plan as SVG, in metres. Rows count downwards there, y upwards here.
fn drawing(plan: &Plan) -> String {
    let [[left, bottom], [right, top]] = [plan.low, plan.high];
    let (width, height) = (right - left, top - bottom);
    let longer = width.max(height);
    let label = format!("{} bounces from above", plan.bounces.len());
    let mut svg = format!(
        "<svg class=\"plan\" role=\"img\" aria-label=\"{label}\" viewBox=\"{left:.3} {:.3} {width:.3} {height:.3}\">\n",
        -top
    );
    for line in &plan.lines {
        let points: Vec<String> = line.iter().map(|[x, y]| format!("{x:.3},{:.3}", -y)).collect();
        let _ = writeln!(svg, "<polyline points=\"{}\"/>", points.join(" "));
    }
    for Spot { bounce, at: [x, y], sigma, angle } in &plan.bounces {
        let [a, b] = sigma.map(|sigma| DRAWN_SIGMAS * sigma);
        let (y, degrees) = (-y, -angle.to_degrees());
        let (size, dot) = (TEXT * longer, DOT * longer);
        let _ = writeln!(
            svg,
            "<g><ellipse cx=\"{x:.3}\" cy=\"{y:.3}\" rx=\"{a:.3}\" ry=\"{b:.3}\" transform=\"rotate({degrees:.1} {x:.3} {y:.3})\"/>\
             <circle cx=\"{x:.3}\" cy=\"{y:.3}\" r=\"{dot:.3}\"/>\
             <text x=\"{:.3}\" y=\"{:.3}\" font-size=\"{size:.3}\">{bounce}</text></g>",
            x + 1.6 * dot,
            y - 1.6 * dot
        );
    }
    svg + "</svg>\n"
}
