//! Random numbers: the same for the same seed on every machine and in every version, and a stream of its own for everything
//! that is drawn.
//!
//! [`StdRng`](rand::rngs::StdRng) is another generator in another version of `rand`; ChaCha with 12 rounds, by name, stays.
//! (It is what `StdRng` was when the published sets were drawn: their clips stay what they are.)

pub use chacha20::ChaCha12Rng as Random;
use nalgebra::RealField;
use rand::distr::uniform::SampleUniform;
use rand::{RngExt, SeedableRng};
use sha2::{Digest, Sha256};

/// What is drawn from a seed. Streams of one seed share no numbers, so what two of them draw is independent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
pub enum Stream {
    /// What a picture, a film or a clip shows, and how its camera takes it.
    Scene = 0,
    /// Whether a random scene is dark, and how dark.
    Night = 1,
    /// The table of normal deviates from which pictures' noise is taken.
    Deviates = 2,
    /// The noise of a film's frame.
    FrameNoise = 3,
    /// Which crops of a random scene the verifier is trained on.
    Candidates = 4,
    /// Which frames a training batch is of.
    Batch = 5,
    /// How one picture of a training batch is cut and lit.
    Augmentation = 6,
    /// Noise on a clip's 2D labels.
    LabelNoise = 7,
    /// How a training clip's camera is turned away.
    CameraError = 8,
}

impl Stream {
    /// Its numbers for `seed`.
    pub fn of(self, seed: u64) -> Random {
        self.start(Random::seed_from_u64(seed))
    }

    /// Its numbers for `seed` and the thing called `name`.
    pub fn of_named(self, seed: u64, name: &str) -> Random {
        self.start(Random::from_seed(Sha256::digest(format!("{seed}/{name}")).into()))
    }

    fn start(self, mut random: Random) -> Random {
        random.set_stream(self as u64);
        random
    }
}

/// Two independent standard normal deviates (Box and Muller). Not `rand_distr`'s: that takes other, and more or fewer, numbers
/// of the stream, and every set, film and training run of a seed would be another one.
pub fn normal_pair<T: RealField + SampleUniform + Copy>(random: &mut Random) -> [T; 2] {
    let least = nalgebra::convert(f64::from(f32::MIN_POSITIVE));
    let radius = (nalgebra::convert::<_, T>(-2.0) * random.random_range(least..T::one()).ln()).sqrt();
    let (sin, cos) = random.random_range(T::zero()..T::two_pi()).sin_cos();
    [radius * cos, radius * sin]
}

/// One seed of a run's seed, a step and a number in it, by SplitMix64's finaliser: neighbouring steps share nothing.
pub fn mixed(seed: u64, step: u64, index: u64) -> u64 {
    [step, index].into_iter().fold(seed, |mixed, part| {
        let mut z = (mixed ^ part).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    })
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;

    const ALL: [Stream; 9] = [
        Stream::Scene,
        Stream::Night,
        Stream::Deviates,
        Stream::FrameNoise,
        Stream::Candidates,
        Stream::Batch,
        Stream::Augmentation,
        Stream::LabelNoise,
        Stream::CameraError,
    ];

    #[test]
    fn streams_of_a_seed_share_no_numbers() {
        for seed in [0, 7, u64::MAX] {
            let mut first: Vec<u64> = ALL.iter().map(|stream| stream.of(seed).next_u64()).collect();
            first.extend(ALL.iter().map(|stream| stream.of_named(seed, "a").next_u64()));
            first.sort_unstable();
            first.dedup();
            assert_eq!(first.len(), 2 * ALL.len());
        }
    }

    /// Numbers of the ChaCha stream cipher: those of any implementation of it, and of every version of ours.
    #[test]
    fn the_generator_is_the_one_that_it_was() {
        // Key and nonce zero, 12 rounds: test vector TC1 of draft-strombergson-chacha-test-vectors-01.
        let mut random = Random::from_seed([0; 32]);
        assert_eq!(random.next_u32().to_le_bytes(), [0x9b, 0xf4, 0x9a, 0x6a]);
        assert_eq!(random.next_u32().to_le_bytes(), [0x07, 0x55, 0xf9, 0x53]);
    }
}
