//! A report for people on a tracked video or a fit: one sentence; numbers with their uncertainty, which say whether they
//! are precise; the reasons of what is not explained; the bounces seen from above. The command's report and the page show the same.

mod plan;
mod say;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix3, Point3};
use serde::Serialize;

pub use self::plan::{Plan, Spot};
use self::say::{counted, inside_sentence, length, sentence, surface};
use crate::{Fit, FittedFrame, FittedImpact, FittedSegment, Flight, Hit, TrackedVideo, listed};
use gravisight_geometry::camera::Camera;
use gravisight_physics::Scene;

/// A position is precise where its error to expect is at most this, m, and at most [`PRECISE_FRACTION`] of its distance from the camera:
/// about a step, on a court.
const PRECISE_POSITION: f64 = 0.3;
/// A speed or a spin is precise where its σ is at most this fraction of it.
const PRECISE_FRACTION: f64 = 0.1;
/// m/s to km/h.
const KMH: f64 = 3.6;

/// A report for people on a tracked video or a fit.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Findings {
    /// What came out, in one sentence.
    pub headline: String,
    /// What is not explained, and why.
    pub reasons: Vec<Reason>,
    /// What else is to be known: repeated frames, cuts, a camera that moved, what is odd about the track.
    pub notes: Vec<String>,
    /// By time.
    pub flights: Vec<FlightFinding>,
    /// Bounces and hits by time.
    pub contacts: Vec<ContactFinding>,
    /// The place from above with the bounces; null without camera and scene.
    pub plan: Option<Plan>,
    /// Whether the ball's position is precise, one a frame: its flight is explained and its error to expect at most 0.3 m and at most a
    /// tenth of its distance from the camera. Empty without camera and scene.
    pub precise: Vec<bool>,
}

/// Why something is not explained.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Reason {
    /// What is not.
    pub what: String,
    /// Why not, as a sentence.
    pub why: String,
}

/// A number with its uncertainty, as text and as numbers.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct Measured {
    /// With its unit.
    pub value: String,
    /// Its σ with the unit, after `±`.
    pub sigma: String,
    /// Whether it is precise: to be read as a fact. A position: to 0.3 m and a tenth of its distance from the camera; a speed and a spin: to a
    /// tenth.
    pub precise: bool,
    /// The number itself: a speed, m/s; a spin, revolutions per second; a position, x, y and z, m.
    pub amount: Vec<f64>,
    /// Its σ, in the same unit.
    pub amount_sigma: f64,
}

/// The report on a flight.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct FlightFinding {
    /// When it is, s.
    pub when: String,
    /// Speed at its start; null where it is not known.
    pub speed: Option<Measured>,
    /// Spin at its start; null where there may be none.
    pub spin: Option<Measured>,
    /// Whether it is explained.
    pub explained: bool,
}

/// The report on a bounce or a hit.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[cfg_attr(target_arch = "wasm32", derive(tsify::Tsify), tsify(missing_as_null))]
#[cfg_attr(target_arch = "wasm32", serde(rename_all = "camelCase"))]
pub struct ContactFinding {
    /// s.
    pub time: f64,
    /// The bounce's number, from 1, as in the plan; null of a hit.
    pub bounce: Option<usize>,
    /// `bounce on the floor`, `hit`.
    pub what: String,
    /// Where; null where it is not known.
    pub place: Option<Measured>,
    /// Speed at which it arrives, m/s; null of a hit, and where it is not known.
    pub speed: Option<f64>,
    /// Probability that it is within the outermost lines; null where those go round nothing, and where it is not known.
    pub within_lines: Option<f64>,
}

/// A result and its report for people.
#[derive(Debug, Clone, Serialize)]
pub struct WithFindings<T> {
    /// Its fields beside [`Self::findings`].
    #[serde(flatten)]
    pub result: T,
    /// Made of it.
    pub findings: Findings,
}

impl Findings {
    /// Of a video that was tracked, with the camera (of its pictures) and the scene that it was fitted with.
    pub fn of_video(video: &TrackedVideo, place: Option<(&Camera, &Scene)>) -> Self {
        let fits =
            || video.segments.iter().filter_map(|segment| Some((segment.frames.start, segment.fit.as_ref().ok()?)));
        let mut findings = Self::default();
        if let Some((camera, scene)) = place {
            findings.precise = vec![false; video.frames.len()];
            for (first, fit) in fits() {
                findings.add(fit, camera);
                for (precise, frame) in findings.precise[first..].iter_mut().zip(&fit.frames) {
                    *precise = frame.explained && is_precise(&frame.world, frame.sigma, camera);
                }
            }
            findings.plan = Some(Plan::new(scene, fits().map(|(_, fit)| fit)));
        }
        findings.reasons.extend(video.segments.iter().filter_map(refused));
        let explained = findings.flights.iter().filter(|flight| flight.explained).count();
        let all = findings.flights.len() + video.segments.iter().filter(|segment| segment.fit.is_err()).count();
        let seen = seen(video);
        findings.headline = match () {
            () if video.found() == 0 => format!("No flying ball was found in these {} frames.", watched(video)),
            () if video.explained.is_none() => format!("{seen}."),
            () if all == 0 => format!("{seen}, but never for long enough to fit a flight: no positions in metres."),
            () => format!("{}; {}.", findings.outcome(explained, all), inside_sentence(&seen)),
        };
        findings.notes = view_notes(video).into_iter().chain(video.notes.iter().map(|note| sentence(note))).collect();
        findings
    }

    /// Of a fit, with its camera and scene.
    ///
    /// ```
    /// # mod gravisight {
    /// # pub use gravisight_geometry::{camera, camera::*, error::*, image::*, size::*};
    /// # pub use gravisight_physics::*;
    /// # pub use gravisight_track::{self as track, findings::*, *};
    /// # }
    /// # fn print(fit: gravisight::Fit, camera: gravisight::Camera, scene: gravisight::Scene) {
    /// use gravisight::Findings;
    ///
    /// let findings = Findings::of_fit(&fit, &camera, &scene);
    /// println!("{}", findings.headline);
    /// for reason in &findings.reasons {
    ///     println!("{}: {}", reason.what, reason.why);
    /// }
    /// # }
    /// ```
    pub fn of_fit(fit: &Fit, camera: &Camera, scene: &Scene) -> Self {
        let mut findings = Self::default();
        findings.add(fit, camera);
        let precise = |frame: &FittedFrame| frame.explained && is_precise(&frame.world, frame.sigma, camera);
        findings.precise = fit.frames.iter().map(precise).collect();
        findings.plan = Some(Plan::new(scene, std::iter::once(fit)));
        let explained = fit.flights.iter().filter(|flight| flight.explained).count();
        let outcome = findings.outcome(explained, fit.flights.len());
        findings.headline = format!("{outcome}; the trajectory misses the labels by {:.2} px (rms).", fit.rms_px);
        findings.notes = fit.notes.iter().map(|note| sentence(note)).collect();
        findings
    }

    /// Adds what a fit found.
    fn add(&mut self, fit: &Fit, camera: &Camera) {
        for flight in &fit.flights {
            self.flights.push(FlightFinding::new(flight));
            if !flight.explained {
                let why = flight.reason.as_deref().unwrap_or("no flight fits its labels");
                let what = format!("Flight {}, {}", self.flights.len(), when(flight));
                self.reasons.push(Reason { what, why: sentence(why) });
            }
        }
        let bounces = self.contacts.iter().filter(|contact| contact.bounce.is_some()).count();
        let bounce = |(index, impact): (usize, &FittedImpact)| ContactFinding {
            time: impact.time,
            bounce: Some(bounces + index + 1),
            what: format!("bounce on {}", surface(impact.surface)),
            place: impact.explained.then(|| place(&impact.world, impact.sigma, camera)),
            speed: impact.explained.then_some(impact.speed),
            within_lines: impact.within_lines.filter(|_| impact.explained),
        };
        let hit = |hit: &Hit| ContactFinding {
            time: hit.time,
            what: "hit".into(),
            place: nearest(fit, hit.time).filter(|_| hit.explained).map(|near| place(&hit.world, near.sigma, camera)),
            ..ContactFinding::default()
        };
        self.contacts.extend(fit.impacts.iter().enumerate().map(bounce));
        self.contacts.extend(fit.hits.iter().map(hit));
        self.contacts.sort_by(|a, b| a.time.total_cmp(&b.time));
    }

    /// How many flights are explained, and what is in them; without the full stop.
    fn outcome(&self, explained: usize, all: usize) -> String {
        let bounces = self.contacts.iter().filter(|contact| contact.bounce.is_some()).count();
        let parts = [(self.contacts.len() - bounces, "hit"), (bounces, "bounce")];
        let parts: Vec<String> =
            parts.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| counted(count, what)).collect();
        let parts = if parts.is_empty() { String::new() } else { format!(", with {}", parts.join(" and ")) };
        match explained {
            0 if all == 1 => "The flight is not explained: no positions in metres".into(),
            0 => format!("None of the {all} flights is explained: no positions in metres"),
            1 if all == 1 => format!("The flight is explained{parts}"),
            _ if explained == all => format!("All {all} flights are explained{parts}"),
            1 => format!("1 of {all} flights is explained{parts}"),
            _ => format!("{explained} of {all} flights are explained{parts}"),
        }
    }
}

impl FlightFinding {
    fn new(flight: &Flight) -> Self {
        let speed = flight.explained.then(|| {
            let [speed, sigma] = [flight.speed_start, flight.speed_sigma];
            let digits = if sigma < 0.095 { 2 } else { 1 };
            Measured {
                value: format!("{speed:.digits$} m/s ({:.0} km/h)", KMH * speed),
                sigma: format!("{sigma:.digits$} m/s"),
                precise: sigma <= PRECISE_FRACTION * speed,
                amount: vec![speed],
                amount_sigma: sigma,
            }
        });
        let revolutions = |spin: [f64; 3]| spin.iter().map(|w| w * w).sum::<f64>().sqrt() / std::f64::consts::TAU;
        let [spin, sigma] = [revolutions(flight.spin), revolutions(flight.spin_sigma)];
        // More is known than that there may be one.
        let spin = (flight.explained && sigma > 0.0 && spin > sigma).then(|| Measured {
            value: format!("{spin:.0} rev/s"),
            sigma: format!("{sigma:.0} rev/s"),
            precise: sigma <= PRECISE_FRACTION * spin,
            amount: vec![spin],
            amount_sigma: sigma,
        });
        Self {
            when: when(flight),
            speed: speed.filter(|_| flight.known_speed().is_some()),
            spin,
            explained: flight.explained,
        }
    }
}

fn when(flight: &Flight) -> String {
    format!("{:.2} to {:.2} s", flight.start, flight.end)
}

/// Whether the position is to be read as a fact.
fn is_precise(world: &Point3<f64>, sigma: f64, camera: &Camera) -> bool {
    let distance = camera.camera_from_world(world).coords.norm();
    sigma <= PRECISE_POSITION.min(PRECISE_FRACTION * distance)
}

fn place(world: &Point3<f64>, sigma: f64, camera: &Camera) -> Measured {
    let [x, y, z] = <[f64; 3]>::from(*world).map(|metres| format!("{metres:.2}").replace('-', "−"));
    Measured {
        value: format!("x {x}, y {y}, z {z} m"),
        sigma: length(sigma),
        precise: is_precise(world, sigma, camera),
        amount: vec![world.x, world.y, world.z],
        amount_sigma: sigma,
    }
}

/// The frame next to a time, s.
fn nearest(fit: &Fit, time: f64) -> Option<&FittedFrame> {
    fit.frames.iter().min_by(|a, b| (a.time - time).abs().total_cmp(&(b.time - time).abs()))
}

/// Covariance of the ball's position next to a time (s), m².
fn covariance_at(fit: &Fit, time: f64) -> Option<Matrix3<f64>> {
    nearest(fit, time).map(|frame| frame.covariance)
}

/// A segment that could not be fitted.
fn refused(segment: &FittedSegment) -> Option<Reason> {
    let why = segment.fit.as_ref().err()?;
    let what = format!("Frames {} to {}", segment.frames.start, segment.frames.end.saturating_sub(1));
    Some(Reason { what, why: sentence(why) })
}

/// Frames that show a picture of their own.
fn watched(video: &TrackedVideo) -> usize {
    video.frames.iter().filter(|frame| !frame.repeated).count()
}

fn seen(video: &TrackedVideo) -> String {
    format!("The ball was found in {} of {} frames", video.found(), watched(video))
}

/// What is to be known of the video itself.
fn view_notes(video: &TrackedVideo) -> Vec<String> {
    let repeated = video.frames.len() - watched(video);
    let repeated = match repeated {
        0 => None,
        1 => Some("1 frame repeats the previous one and is left out.".into()),
        count => Some(format!("{count} frames repeat the previous ones and are left out.")),
    };
    let note = |spans: Vec<String>, before: &str, after: &str| {
        (!spans.is_empty()).then(|| format!("{before} {}{after}.", listed(&spans, ", ")))
    };
    let cuts = video.cuts.iter().map(usize::to_string).collect();
    let moved = video.elsewhere.iter();
    let moved = moved.filter_map(|it| Some(format!("{} to {} (by up to {:.0} px)", it.from, it.to, it.moved_px?)));
    let lost = video.elsewhere.iter().filter(|view| view.moved_px.is_none());
    let lost = lost.map(|view| format!("{} to {}", view.from, view.to));
    let metres = if video.explained.is_some() { ": no positions in metres there" } else { "" };
    let notes = [
        note(cuts, "Most of the picture changes at frame", ": a cut, or the camera moved"),
        note(moved.collect(), "The camera moves in frames", ""),
        note(lost.collect(), "A different view from the first is shown in frames", metres),
    ];
    repeated.into_iter().chain(notes.into_iter().flatten()).collect()
}
