//! What `track` found, in words.

use anyhow::Result;
use gravisight::Tracked;

use super::super::print_line;

/// m/s to km/h.
const KMH: f64 = 3.6;

pub(super) fn print(tracked: &Tracked) -> Result<()> {
    print_line(tracked.verdict())?;
    let mut number = 0;
    for stretch in &tracked.stretches {
        let Ok(fit) = &stretch.fit else { continue };
        for note in &fit.notes {
            print_line(format_args!("note: {note}"))?;
        }
        for flight in &fit.flights {
            number += 1;
            let [speed, sigma] = flight.speed;
            let digits = if sigma < 0.095 { 2 } else { 1 };
            let spin = flight.spin.iter().map(|w| w * w).sum::<f64>().sqrt() / std::f64::consts::TAU;
            print_line(format_args!(
                "flight {number}: {:.2} to {:.2} s, starts at {speed:.digits$} ± {sigma:.digits$} m/s ({:.0} km/h), spin {spin:.0} rev/s{}",
                flight.start,
                flight.end,
                KMH * speed,
                if flight.explained { "" } else { "  (not explained)" }
            ))?;
        }
        let mut contacts: Vec<(f64, String)> = Vec::new();
        for impact in &fit.impacts {
            let [x, y, z] = impact.position.into();
            let sigma = 100.0 * fit.sigma_at(impact.time).unwrap_or_default();
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
            stretch.frames.start,
            stretch.frames.end - 1,
            100.0 * sigmas[sigmas.len() / 2]
        ))?;
    }
    Ok(())
}
