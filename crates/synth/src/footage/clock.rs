//! When frames are filmed, and when shown: rates of frames are converted by showing some twice.

use rand::RngExt;

use gravisight_geometry::random::Random;

/// Rates of broadcasts' and phones' cameras, frames a second.
const BROADCAST: [f64; 6] = [25.0, 25.0, 50.0, 50.0, 30.0, 24.0];
const PHONE: [f64; 7] = [15.0, 24.0, 30.0, 30.0, 60.0, 120.0, 240.0];
/// What a rate is converted to.
const CONVERTED: [(f64, f64); 3] = [(24.0, 30.0), (25.0, 30.0), (50.0, 60.0)];
/// How often it is.
const CONVERSION: f64 = 0.4;
/// How long a shutter is open, as a fraction of a frame's time, and at most, s.
const SHUTTER: std::ops::Range<f64> = 0.06..0.65;
const LONGEST: f64 = 0.02;

/// A clip's rates.
#[derive(Debug, Clone)]
pub(super) struct Clock {
    /// Frames a second, filmed and shown.
    pub filmed: f64,
    pub shown: f64,
    /// Where in a filmed frame the first shown one lies, frames.
    phase: f64,
    /// How long the shutter is open, s.
    pub exposure: f64,
}

impl Clock {
    pub fn draw(official: bool, random: &mut Random) -> Self {
        let rates: &[f64] = if official { &BROADCAST } else { &PHONE };
        let filmed = rates[random.random_range(0..rates.len())];
        let converted = CONVERTED.iter().find(|(from, _)| *from == filmed).filter(|_| random.random_bool(CONVERSION));
        let shutter = random.random_range(SHUTTER.start.ln()..SHUTTER.end.ln()).exp();
        Self {
            filmed,
            shown: converted.map_or(filmed, |(_, to)| *to),
            phase: random.random_range(0.0..1.0),
            exposure: (shutter / filmed).min(LONGEST),
        }
    }

    /// Which of the filmed frames a shown one is.
    pub fn source(&self, frame: usize) -> usize {
        if self.filmed == self.shown {
            return frame;
        }
        (frame as f64 * self.filmed / self.shown + self.phase) as usize
    }

    /// When a shown frame was filmed, s.
    pub fn time(&self, frame: usize) -> f64 {
        self.source(frame) as f64 / self.filmed
    }

    /// Whether a shown frame is the one before it again.
    pub fn repeats(&self, frame: usize) -> bool {
        frame > 0 && self.source(frame) == self.source(frame - 1)
    }

    /// Frames shown of what lasts so long, s.
    pub fn frames(&self, lasts: f64) -> usize {
        (0..).take_while(|&frame| self.time(frame) < lasts).count()
    }
}
