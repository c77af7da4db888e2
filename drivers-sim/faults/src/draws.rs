//! Random numbers of one fault.

use rand::RngExt;
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

/// A generator that depends on seed and name alone.
#[derive(Clone, Debug)]
pub(crate) struct Draws(Pcg64);

impl Draws {
    /// `name`: what the fault is, and the how-manieth of that name.
    pub(crate) fn new(seed: u64, name: &str, ordinal: usize) -> Draws {
        // FNV-1a of the name (Fowler, Noll, Vo), spread by SplitMix64.
        let hash = name
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
        let mut mixer = seed ^ split_mix(&mut hash.wrapping_add(ordinal as u64));
        let mut wide = || (u128::from(split_mix(&mut mixer)) << 64) | u128::from(split_mix(&mut mixer));
        let (state, sequence) = (wide(), wide());
        Draws(Pcg64::new(state, sequence))
    }

    /// Uniform between 0 and 1.
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0.random()
    }

    /// Uniform between two numbers.
    pub(crate) fn between(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * self.uniform()
    }

    /// Normal with that sigma.
    pub(crate) fn normal(&mut self, sigma: f64) -> f64 {
        let unit: f64 = self.0.sample(StandardNormal);
        unit * sigma
    }

    /// True with that probability; always one draw.
    pub(crate) fn happens(&mut self, probability: f64) -> bool {
        self.uniform() < probability
    }

    /// Of either sign, between half and one and a half `size`.
    pub(crate) fn spike(&mut self, size: f64) -> f64 {
        let sign = if self.happens(0.5) { 1.0 } else { -1.0 };
        sign * size * self.between(0.5, 1.5)
    }
}

/// One step of SplitMix64 (Steele, Lea, Flood 2014).
fn split_mix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}
