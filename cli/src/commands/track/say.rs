//! What `track` found, in words.

use anyhow::Result;
use gravisight::parts::{FittedSegment, Flight};
use gravisight::{Camera, Fit, TrackedVideo};
use nalgebra::Point3;

use super::super::fit::DOUBTFUL;
use super::super::print_line;

/// m/s to km/h.
const KMH: f64 = 3.6;

/// Prints what was found of a video that `camera` took, if that is known.
pub(super) fn print(tracked: &TrackedVideo, camera: Option<&Camera>) -> Result<()> {
    print_line(&tracked.verdict)?;
    let Some(camera) = camera else { return Ok(()) };
    let mut number = 0;
    for segment in &tracked.segments {
        let Ok(fit) = &segment.fit else { continue };
        for note in &fit.notes {
            print_line(format_args!("note: {note}"))?;
        }
        for flight in &fit.flights {
            number += 1;
            print_line(of_flight(number, flight))?;
        }
        for (time, what) in contacts(fit) {
            print_line(format_args!("{time:.2} s: {what}"))?;
        }
        print_line(positions(segment, fit, camera))?;
    }
    Ok(())
}

fn of_flight(number: usize, flight: &Flight) -> String {
    let when = format!("flight {number}: {:.2} to {:.2} s", flight.start, flight.end);
    match flight.known_speed() {
        _ if !flight.explained => format!("{when}, not explained: speed, spin and position are unknown"),
        None => format!("{when}, speed not known"),
        Some([speed, sigma]) => {
            let digits = if sigma < 0.095 { 2 } else { 1 };
            let spin = flight.spin.iter().map(|w| w * w).sum::<f64>().sqrt() / std::f64::consts::TAU;
            let kmh = KMH * speed;
            format!("{when}, starts at {speed:.digits$} ± {sigma:.digits$} m/s ({kmh:.0} km/h), spin {spin:.0} rev/s")
        }
    }
}

/// Bounces and hits by time. Where one is that belongs to a flight that is not explained is not known.
fn contacts(fit: &Fit) -> Vec<(f64, String)> {
    let mut contacts: Vec<(f64, String)> = Vec::new();
    let mut add = |time: f64, what: String, at: Point3<f64>, sigma: Option<f64>, explained: bool| {
        let [x, y, z] = at.into();
        let sigma = sigma.map_or(String::new(), |sigma| format!(", ± {:.0} cm", 100.0 * sigma));
        let place = match explained {
            true => format!("at x {x:.2}  y {y:.2}  z {z:.2} m{sigma}"),
            false => DOUBTFUL.into(),
        };
        contacts.push((time, format!("{what} {place}")));
    };
    for impact in &fit.impacts {
        let what = format!("touches {}", impact.surface);
        add(impact.time, what, impact.world, Some(impact.sigma), impact.explained);
    }
    for hit in &fit.hits {
        add(hit.time, "hit".into(), hit.world, None, hit.explained);
    }
    contacts.sort_by(|a, b| a.0.total_cmp(&b.0));
    contacts
}

/// How well the positions are known.
fn positions(segment: &FittedSegment, fit: &Fit, camera: &Camera) -> String {
    let frames = format!("frames {} to {}", segment.frames.start, segment.frames.end - 1);
    let (sigmas, all) = (fit.known_sigmas(camera), fit.frames.len());
    let Some(median) = sigmas.get(sigmas.len() / 2) else { return format!("{frames}: positions not known") };
    let of = if sigmas.len() == all { String::new() } else { format!("; not known in {} frames", all - sigmas.len()) };
    format!("{frames}: positions ± {:.0} cm (1-σ, median{of})", 100.0 * median)
}
