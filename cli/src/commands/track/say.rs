//! What `track` found, in words and as JSON.

use anyhow::Result;
use gravisight::Fit;
use gravisight::parts::FollowedFrame;
use serde_json::{Value, json};

use super::super::print_line;
use super::{Part, Sight};

/// m/s to km/h.
const KMH: f64 = 3.6;

pub(super) fn verdict(found: usize, frames: &[FollowedFrame], parts: &[Part], metres: bool) -> String {
    let repeated = frames.iter().filter(|frame| frame.repeated).count();
    let repeated = match repeated {
        0 => String::new(),
        count => format!(" ({count} more show the one before again)"),
    };
    let all = frames.iter().filter(|frame| !frame.repeated).count();
    if found == 0 {
        return format!("no ball: nothing flies in these {all} frames{repeated}");
    }
    let seen = format!("the ball is seen in {found} of {all} frames{repeated}");
    if !metres {
        return seen;
    }
    if parts.is_empty() {
        return format!("{seen}, nowhere long enough to say more");
    }
    let of = |part: &Part| match &part.fit {
        Ok(fit) => fit.verdict(),
        Err(error) => format!("not explained: {error}"),
    };
    if let [part] = parts {
        return format!("{}; {seen}", of(part));
    }
    let explained = parts.iter().filter(|part| part.fit.as_ref().is_ok_and(|fit| fit.explained)).count();
    let wrong = parts.iter().enumerate().filter(|(_, part)| !part.fit.as_ref().is_ok_and(|fit| fit.explained));
    let wrong: Vec<String> = wrong.map(|(number, part)| format!("stretch {}: {}", number + 1, of(part))).collect();
    let head = if wrong.is_empty() { "explained" } else { "not all explained" };
    let tail = if wrong.is_empty() { String::new() } else { format!("; {}", wrong.join("; ")) };
    format!("{head}: {explained} of {} stretches; {seen}{tail}", parts.len())
}

/// What a change of the whole picture means.
pub(super) fn cuts_in_words(cuts: &[usize], metres: bool) -> String {
    if cuts.is_empty() {
        return String::new();
    }
    let frames: Vec<String> = cuts.iter().map(usize::to_string).collect();
    let hold = if metres { "; metres hold only where the view is the calibrated one" } else { "" };
    format!("; most of the picture changes at frame {}: a cut, or the camera moved{hold}", frames.join(", "))
}

/// A stretch's flight, hits and bounces count on from those before.
pub(super) fn as_json(sights: &[Sight], parts: &[Part], verdict: &str) -> Value {
    let frame = |(number, sight): (usize, &Sight)| {
        let seen = sight.point.visibility > 0;
        json!({"frame": number, "time": sight.point.time, "image": sight.point.image().map(|at| [at.x, at.y]),
            "radius_px": sight.point.radius, "world": null, "sigma": null, "flight": null,
            "confidence": if seen { json!(sight.confidence) } else { json!(0.0) }})
    };
    let mut frames: Vec<Value> = sights.iter().enumerate().map(frame).collect();
    let (mut flights, mut hits, mut bounces, mut notes) = (vec![], vec![], vec![], vec![]);
    for Part { frames: range, fit, .. } in parts {
        let Ok(fit) = fit else { continue };
        let mut said = fit.as_json();
        for (frame, fitted) in frames[range.clone()].iter_mut().zip(&fit.frames) {
            frame["world"] = json!(<[f64; 3]>::from(fitted.state.position.coords));
            frame["sigma"] = json!(fitted.sigma());
            frame["flight"] = json!(flights.len() + fitted.flight);
            frame["speed"] = json!(fitted.state.velocity.norm());
        }
        for (value, hit) in said["hits"].as_array_mut().into_iter().flatten().zip(&fit.hits) {
            value["frame"] = json!(range.start + hit.frame);
            hits.push(value.take());
        }
        flights.extend(said["flights"].as_array_mut().into_iter().flatten().map(Value::take));
        bounces.extend(fit.impacts.iter().map(|impact| {
            json!({"time": impact.time, "surface": impact.surface.to_string(),
                "world": <[f64; 3]>::from(impact.position), "speed": impact.speed, "sigma": sigma_at(fit, impact.time)})
        }));
        notes.extend(fit.notes.iter().cloned());
    }
    json!({"verdict": verdict, "frames": frames, "flights": flights, "hits": hits, "bounces": bounces, "notes": notes})
}

/// 1-σ of the position in the frame next to a time, m.
fn sigma_at(fit: &Fit, time: f64) -> Option<f64> {
    let near = fit.frames.iter().min_by(|a, b| (a.time - time).abs().total_cmp(&(b.time - time).abs()));
    near.map(|frame| frame.sigma())
}

pub(super) fn print(verdict: &str, parts: &[Part]) -> Result<()> {
    print_line(verdict)?;
    let mut number = 0;
    for part in parts {
        let Ok(fit) = &part.fit else { continue };
        for note in &fit.notes {
            print_line(format_args!("note: {note}"))?;
        }
        for flight in &fit.flights {
            number += 1;
            let [speed, sigma] = flight.speed;
            let spin = flight.spin.iter().map(|w| w * w).sum::<f64>().sqrt() / std::f64::consts::TAU;
            print_line(format_args!(
                "flight {number}: {:.2} to {:.2} s, starts at {speed:.1} ± {sigma:.1} m/s ({:.0} km/h), spin {spin:.0} rev/s{}",
                flight.start,
                flight.end,
                KMH * speed,
                if flight.explained { "" } else { "  (not explained)" }
            ))?;
        }
        let mut contacts: Vec<(f64, String)> = Vec::new();
        for impact in &fit.impacts {
            let [x, y, z] = impact.position.into();
            let sigma = 100.0 * sigma_at(fit, impact.time).unwrap_or_default();
            contacts.push((
                impact.time,
                format!("touches {} at x {x:.2}  y {y:.2}  z {z:.2} m, ± {sigma:.0} cm", impact.surface),
            ));
        }
        for hit in &fit.hits {
            let [x, y, z] = hit.position.coords.into();
            contacts.push((hit.time, format!("hit at x {x:.2}  y {y:.2}  z {z:.2} m")));
        }
        contacts.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (time, what) in contacts {
            print_line(format_args!("{time:.2} s: {what}"))?;
        }
        let mut sigmas: Vec<f64> = fit.frames.iter().map(|frame| frame.sigma()).collect();
        sigmas.sort_by(f64::total_cmp);
        print_line(format_args!(
            "frames {} to {}: positions ± {:.0} cm (1-σ, median)",
            part.frames.start,
            part.frames.end - 1,
            100.0 * sigmas[sigmas.len() / 2]
        ))?;
    }
    Ok(())
}
