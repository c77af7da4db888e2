//! Are a sensor's stamps right, and is it calibrated? The second half of the time-offset detector, what the first half in the
//! preprocessor cannot see without an estimate, and the same for what [`CALIBRATIONS`] lists.
//!
//! The columns beside the chain (`columns.rs`) say at every keyframe what each error would be, and how surely. A reading
//! that was refused stands in no row of the chain, and may have been refused because of such an error; it is heard here with
//! its innovation. Then, σ_g being the sigma of what is found,
//!
//! ```text
//! |ĝ| > 4.5 σ_g      readings are corrected: by ĝ in the window, and those to come; once they have been,
//!                    4 σ_g, or 3 σ_g if that is surer than what was known
//! |ĝ| > 2.5 σ_g      not sure enough, but possible: covariances cover it, ĝ² + σ_g²
//! corrected before   covariances cover what is still unknown of it
//! ```
//!
//! One error looks much like another: a scale of all ranges like late stamps of a vehicle that goes away. So only the surest
//! of a keyframe is corrected; the others are then looked at anew. An error of another kind may look like each of them for a
//! while: a heading that is disturbed while the vehicle turns. So σ_g is what the columns say times √χ², χ² being what the error
//! leaves of the sensor's squared innovations per degree of freedom: this one explains them, the other does not.
//!
//! Two covariances cover an error of sigma σ: that of a reading to come, by ḣ²σ² (ḣ = ∂h/∂g), and that of the state, by VVᵀσ²
//! with V = ∂x/∂g of the readings that have been. A sensor without errors costs nothing by this: its rows stay what they were.

use nav_models::innovation::Innovation;
use nav_models::row::SLOTS;
use shared_types::{AIDING, CALIBRATIONS, Calibration, Duration, SensorConfig, TimeOffset};

use crate::columns::{Score, TERMS, fadings, or_nothing};

/// How many errors there are: time offsets in the order of [`AIDING`], then [`CALIBRATIONS`].
pub const ERRORS: usize = STAMPS + CALIBRATIONS.len();
/// The first of them are of stamps.
pub const STAMPS: usize = AIDING.len();

/// The errors of the readings of a sensor by its place in [`AIDING`]: slot of [`nav_models::row::SLOTS`], error.
pub const fn errors_of(sensor: usize) -> &'static [(usize, usize)] {
    const BY_SENSOR: [&[(usize, usize)]; STAMPS] = [
        &[(0, 0), (1, STAMPS + Calibration::RangeScale.index())],
        &[(0, 1)],
        &[(0, 2), (1, STAMPS + Calibration::DvlScale.index())],
        &[(0, 3)],
        &[(0, 4)],
    ];
    BY_SENSOR[sensor]
}

/// The place in [`AIDING`] of an error's sensor.
pub fn sensor_of(error: usize) -> usize {
    (0..STAMPS).find(|&sensor| errors_of(sensor).iter().any(|&(_, other)| other == error)).unwrap_or(0)
}

/// Standard deviations at which readings are corrected for the first time. Chance does that to one of seven errors that are none
/// once in some hundred hours.
const SURE: f64 = 4.5;
/// The same once they have been corrected, when an error is no surprise any more; and where the new sigma is below the old.
const SURE_AGAIN: f64 = 4.0;
const SURER: f64 = 3.0;
/// Standard deviations at which an error is possible.
const POSSIBLE: f64 = 2.5;

/// χ² per degree of freedom above which a calibration does not explain the innovations: the state itself may be wrong, as with a
/// heading turned round, and a scale of the ranges would only hide that.
const EXPLAINED: f64 = 1.5;

/// What may be believed of an error, in its unit.
#[derive(Clone, Copy, Debug)]
struct Limits {
    /// One that is smaller is not worth a correction.
    smallest: f64,
    /// Lowest and largest that is believed.
    range: [f64; 2],
    /// One that is known no better than this is covered but corrects nothing: what little motion there is tells as much of
    /// other errors.
    vague: f64,
    /// How far it may wander after it was found, per √s, and how far at most.
    wandering: f64,
    wandering_most: f64,
}

/// Of a stamp, s. What 10 ms do is below a centimetre at usual speeds; a stamp may be late by a second, and early by some of
/// a sensor's own filtering.
const STAMP: Limits = Limits { smallest: 0.01, range: [-0.2, 1.0], vague: 0.12, wandering: 5e-3, wandering_most: 0.1 };

const fn limits(error: usize) -> Limits {
    if error < STAMPS {
        return STAMP;
    }
    match CALIBRATIONS[error - STAMPS] {
        // 30 m/s of sound speed at most.
        Calibration::RangeScale => {
            Limits { smallest: 5e-5, range: [-0.02, 0.02], vague: 2e-3, wandering: 1e-5, wandering_most: 3e-4 }
        }
        Calibration::DvlScale => {
            Limits { smallest: 3e-4, range: [-0.05, 0.05], vague: 0.01, wandering: 1e-5, wandering_most: 1e-3 }
        }
    }
}

/// One systematic error.
#[derive(Clone, Copy, Debug)]
struct Systematic {
    is_estimated: bool,
    limits: Limits,
    /// Taken off the readings.
    applied: f64,
    /// 1-sigma of that; 0 while nothing speaks against the readings.
    sigma: f64,
    /// The memory that says so.
    term: usize,
    /// Readings have been corrected.
    was_corrected: bool,
    /// Of refused readings, fading.
    refused: [Score; TERMS],
    /// Squared innovations of its sensor and their degrees of freedom, fading.
    innovations: [(f64, f64); TERMS],
}

/// Those of all aiding sensors.
#[derive(Clone, Debug)]
pub struct Systematics {
    errors: [Systematic; ERRORS],
}

/// Readings are to be corrected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    /// For this error.
    pub error: usize,
    /// By so much of its unit.
    pub by: f64,
    /// As this memory has it.
    pub term: usize,
}

/// An error that is sure.
#[derive(Clone, Copy, Debug)]
struct Found {
    correction: Correction,
    sigma: f64,
    deviation: f64,
}

impl Systematics {
    /// As configured.
    pub fn new(sensors: &[SensorConfig; AIDING.len()]) -> Systematics {
        Systematics {
            errors: core::array::from_fn(|error| {
                let SensorConfig { time_offset, calibrate, .. } = sensors[sensor_of(error)];
                let (applied, is_estimated) = match time_offset {
                    _ if error >= STAMPS => (0.0, calibrate),
                    TimeOffset::Off => (0.0, false),
                    TimeOffset::Fixed(offset) => (offset, false),
                    TimeOffset::Estimated(offset) => (offset, true),
                };
                Systematic {
                    is_estimated,
                    limits: limits(error),
                    applied,
                    sigma: 0.0,
                    term: 0,
                    was_corrected: is_estimated && applied != 0.0,
                    refused: [Score::default(); TERMS],
                    innovations: [(0.0, 0.0); TERMS],
                }
            }),
        }
    }

    /// Goes on with offsets and calibrations of an earlier run, each with their sigmas.
    pub fn resume(&mut self, offsets: [&[f64; STAMPS]; 2], calibrations: [&[f64; CALIBRATIONS.len()]; 2]) {
        let [found, sigmas] = [0, 1].map(|part| offsets[part].iter().chain(calibrations[part]));
        for ((error, &found), &sigma) in self.errors.iter_mut().zip(found).zip(sigmas) {
            let is_sane = error.limits.believes(found) && (0.0..=error.limits.range[1]).contains(&sigma);
            if error.is_estimated && is_sane {
                error.applied = found;
                error.sigma = sigma;
                error.was_corrected = found != 0.0;
            }
        }
    }

    /// How much too late a sensor's stamps are taken to be.
    pub fn offset(&self, sensor: usize) -> Duration {
        Duration::from_seconds(self.errors[sensor].applied)
    }

    /// What an error is taken to be.
    pub fn of(&self, error: usize) -> f64 {
        self.errors[error].applied
    }

    /// Whether anybody asks for it.
    pub fn is_estimated(&self, error: usize) -> bool {
        self.errors[error].is_estimated
    }

    /// 1-sigma of each error of a sensor's readings, by their slots, that covariances have to cover.
    pub fn sigmas(&self, sensor: usize) -> [f64; SLOTS] {
        let mut sigmas = [0.0; SLOTS];
        for &(slot, error) in errors_of(sensor) {
            if self.errors[error].is_estimated {
                sigmas[slot] = self.errors[error].sigma;
            }
        }
        sigmas
    }

    /// What the covariance of the state has to cover: error, memory and variance.
    pub fn to_cover(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let doubtful = self.errors.iter().enumerate().filter(|(_, error)| error.is_estimated && error.sigma > 0.0);
        doubtful.map(|(index, error)| (index, error.term, error.sigma * error.sigma))
    }

    /// How late the stamps of the [`AIDING`] sensors are taken to be, and the sigmas of that, s.
    pub fn time_offsets(&self) -> ([f64; AIDING.len()], [f64; AIDING.len()]) {
        self.published(0)
    }

    /// What [`CALIBRATIONS`] are taken to be off by, and the sigmas of that.
    pub fn calibrations(&self) -> ([f64; CALIBRATIONS.len()], [f64; CALIBRATIONS.len()]) {
        self.published(STAMPS)
    }

    fn published<const COUNT: usize>(&self, first: usize) -> ([f64; COUNT], [f64; COUNT]) {
        let of = |value: fn(&Systematic) -> f64| core::array::from_fn(|at| value(&self.errors[first + at]));
        (of(|error| error.applied), of(|error| error.sigma))
    }

    /// A reading was judged, with this weight of its kernel.
    pub fn observe(&mut self, sensor: usize, innovation: &Innovation, components: usize, weight: f64) {
        for &(_, error) in errors_of(sensor) {
            for (squares, freedom) in &mut self.errors[error].innovations {
                *squares += weight * innovation.nis;
                *freedom += components as f64;
            }
        }
    }

    /// A reading was refused by its gate; `weight` is that of its kernel at its innovation.
    pub fn observe_refused(&mut self, sensor: usize, innovation: &Innovation, weight: f64) {
        for &(slot, error) in errors_of(sensor) {
            for refused in &mut self.errors[error].refused {
                for (slope, value) in innovation.slopes[slot].iter().zip(&innovation.whitened) {
                    refused.information += weight * slope * slope;
                    refused.right -= weight * slope * value;
                }
            }
        }
    }

    /// Judges every error after a solve `dt` after the last, given what the chain's columns say of it. The surest is taken to
    /// be corrected.
    pub fn judge(&mut self, mut scores: impl FnMut(usize) -> [Score; TERMS], dt: Duration) -> Option<Correction> {
        let mut surest: Option<Found> = None;
        for (index, error) in self.errors.iter_mut().enumerate() {
            if !error.is_estimated {
                continue;
            }
            let found = error.judge(index, scores(index), dt);
            if found.is_some_and(|found| surest.is_none_or(|surest| found.deviation > surest.deviation)) {
                surest = found;
            }
        }
        let Found { correction, sigma, .. } = surest?;
        let error = &mut self.errors[correction.error];
        error.applied += correction.by;
        error.sigma = sigma;
        error.was_corrected = true;
        for refused in &mut error.refused {
            refused.right -= refused.information * correction.by;
        }
        Some(correction)
    }
}

impl Limits {
    fn believes(&self, value: f64) -> bool {
        (self.range[0]..=self.range[1]).contains(&value)
    }
}

impl Systematic {
    /// Fades what was heard, brings the sigma up to date, and says whether the error is sure.
    fn judge(&mut self, index: usize, scores: [Score; TERMS], dt: Duration) -> Option<Found> {
        for (refused, faded) in self.refused.iter_mut().zip(fadings(dt)) {
            refused.information = or_nothing(refused.information * (faded * faded));
            refused.right = or_nothing(refused.right * faded);
        }
        for ((squares, freedom), faded) in self.innovations.iter_mut().zip(fadings(dt)) {
            *squares = or_nothing(*squares * (faded * faded));
            *freedom = or_nothing(*freedom * (faded * faded));
        }
        let Limits { smallest, range: [_, largest], vague, wandering, wandering_most } = self.limits;
        self.sigma = match self.was_corrected {
            true => self.sigma.hypot(wandering * dt.as_seconds().sqrt()).min(wandering_most),
            false => 0.0,
        };
        // The memory that is surest of an error.
        let (term, found, sigma) = (0..TERMS)
            .filter_map(|term| {
                let (found, sigma) = scores[term].plus(&self.refused[term]).found(largest)?;
                let (squares, freedom) = self.innovations[term];
                let left = (squares - (found / sigma).powi(2)) / freedom.max(1.0);
                if index >= STAMPS && left > EXPLAINED {
                    return None;
                }
                Some((term, found, sigma * left.max(1.0).sqrt()))
            })
            .max_by(|a, b| (a.1.abs() / a.2).total_cmp(&(b.1.abs() / b.2)))?;
        let deviation = found.abs() / sigma;
        let sure = match self.was_corrected {
            false => SURE,
            true if sigma < self.sigma => SURER,
            true => SURE_AGAIN,
        };
        if deviation > POSSIBLE {
            self.term = term;
            self.sigma = self.sigma.max(found.hypot(sigma).min(largest));
        } else if self.was_corrected {
            self.term = term;
            self.sigma = self.sigma.min(sigma);
        }
        let is_believable = sigma < vague && self.limits.believes(self.applied + found);
        let is_sure = deviation >= sure && found.abs() >= smallest && is_believable;
        is_sure.then_some(Found { correction: Correction { error: index, by: found, term }, sigma, deviation })
    }
}

impl Score {
    /// The same, where its right side also varies by this variance, of something else that is unknown.
    #[must_use]
    pub fn in_doubt(self, variance: f64) -> Score {
        let share = self.information / (self.information + variance);
        if variance > 0.0 && share.is_finite() {
            Score { information: self.information * share, right: self.right * share }
        } else {
            self
        }
    }

    fn plus(&self, other: &Score) -> Score {
        Score { information: self.information + other.information, right: self.right + other.right }
    }

    /// Error and sigma; `None` where less is known than that it is no larger than `largest`.
    fn found(&self, largest: f64) -> Option<(f64, f64)> {
        // Rounding may leave less than nothing of no information; the comparison also refuses what is no number.
        let is_known = self.information > 1.0 / (largest * largest) && self.right.is_finite();
        is_known.then(|| (self.right / self.information, self.information.sqrt().recip()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nav_models::innovation::Innovation;

    const SECOND: Duration = Duration(1_000_000_000);
    const DVL: usize = 2;

    const SCALE: usize = STAMPS + Calibration::DvlScale.index();

    fn offsets(time_offset: TimeOffset) -> Systematics {
        let mut config = shared_types::Config::default().navigator.sensors;
        config.iter_mut().for_each(|sensor| (sensor.time_offset, sensor.calibrate) = (time_offset, true));
        Systematics::new(&config)
    }

    /// Judges with a score of one error alone.
    fn judge(errors: &mut Systematics, error: usize, score: [Score; TERMS]) -> Option<Correction> {
        errors.judge(|of| if of == error { score } else { [Score::default(); TERMS] }, SECOND)
    }

    /// A score that says `found` with `sigma`, by the long memory alone.
    fn score(found: f64, sigma: f64) -> [Score; TERMS] {
        let information = 1.0 / (sigma * sigma);
        [Score::default(), Score { information, right: found * information }]
    }

    #[test]
    fn a_sure_offset_moves_the_stamps_and_is_published_with_its_sigma() {
        let mut offsets = offsets(TimeOffset::Estimated(0.0));
        assert_eq!(judge(&mut offsets, DVL, score(0.2, 0.04)), Some(Correction { error: DVL, by: 0.2, term: 1 }));
        assert_eq!(offsets.offset(DVL), Duration::from_seconds(0.2));
        let (found, sigma) = offsets.time_offsets();
        assert!((found[DVL] - 0.2).abs() < 1e-15 && (sigma[DVL] - 0.04).abs() < 1e-15);
        assert_eq!(found[0], 0.0);
        // Another third of a sigma is no news; four sigmas are, though they would not have been before.
        assert_eq!(judge(&mut offsets, DVL, score(0.01, 0.04)), None);
        assert!(judge(&mut offsets, DVL, score(-0.16, 0.04)).is_some());
        assert!((offsets.time_offsets().0[DVL] - 0.04).abs() < 1e-12);
    }

    #[test]
    fn a_possible_offset_is_covered_and_nothing_is_moved() {
        let mut offsets = offsets(TimeOffset::Estimated(0.0));
        assert_eq!(judge(&mut offsets, DVL, score(0.12, 0.04)), None);
        assert!((offsets.sigmas(DVL)[0] - 0.12_f64.hypot(0.04)).abs() < 1e-15);
        assert_eq!(offsets.to_cover().count(), 1);
        assert_eq!(judge(&mut offsets, DVL, score(0.04, 0.04)), None);
        assert_eq!(offsets.sigmas(DVL)[0], 0.0, "it was chance");
        assert_eq!(offsets.to_cover().count(), 0);
    }

    #[test]
    fn what_is_unknown_of_a_moved_stamp_grows_and_does_not_grow_for_ever() {
        let mut offsets = offsets(TimeOffset::Estimated(0.0));
        judge(&mut offsets, DVL, score(0.2, 0.01));
        for _ in 0..10_000 {
            assert_eq!(judge(&mut offsets, DVL, [Score::default(); TERMS]), None);
        }
        assert_eq!(offsets.sigmas(DVL)[0], STAMP.wandering_most);
    }

    #[test]
    fn refused_readings_that_agree_on_an_offset_move_the_stamps() {
        let mut offsets = offsets(TimeOffset::Estimated(0.0));
        let refused = Innovation {
            whitened: [-8.0, 0.0, 0.0],
            nis: 64.0,
            state_share: 0.0,
            slopes: [[20.0, 0.0, 0.0], [0.0; 3]],
        };
        let mut moved = None;
        for _ in 0..20 {
            offsets.observe_refused(DVL, &refused, 0.1);
            moved = moved.or(judge(&mut offsets, DVL, [Score::default(); TERMS]));
        }
        let by = moved.expect("twenty agree").by;
        // An offset that has been there for a while is taken for one that has grown: a little too much.
        assert!((0.39..0.44).contains(&by), "{by}");
    }

    #[test]
    fn an_offset_that_nobody_asks_for_stays_what_it_is() {
        let mut fixed = offsets(TimeOffset::Fixed(0.1));
        assert_eq!(judge(&mut fixed, DVL, score(0.3, 0.01)), None);
        assert_eq!((fixed.offset(DVL), fixed.is_estimated(DVL)), (Duration::from_seconds(0.1), false));
        let mut off = offsets(TimeOffset::Off);
        assert_eq!(judge(&mut off, DVL, score(0.3, 0.01)), None);
        assert_eq!((off.offset(DVL), off.is_estimated(DVL)), (Duration::ZERO, false));
    }

    #[test]
    fn what_else_moves_a_score_leaves_its_error_and_widens_its_sigma() {
        let [_, sure] = score(0.2, 0.04);
        let (found, sigma) = sure.in_doubt(3.0 / (0.04 * 0.04)).found(1.0).expect("known");
        assert!((found - 0.2).abs() < 1e-12 && (sigma - 0.08).abs() < 1e-12, "{found} {sigma}");
        assert_eq!(sure.in_doubt(0.0), sure);
        assert_eq!(Score::default().in_doubt(1.0).information, 0.0);
    }

    #[test]
    fn no_number_is_no_news() {
        let mut offsets = offsets(TimeOffset::Estimated(0.0));
        for information in [f64::NAN, f64::INFINITY, -1.0, 0.0] {
            let score = [Score { information, right: f64::NAN }; TERMS];
            assert_eq!(judge(&mut offsets, DVL, score), None);
        }
        assert_eq!(offsets.sigmas(DVL)[0], 0.0);
    }

    #[test]
    fn an_offset_found_before_is_taken_up_and_nonsense_is_not() {
        let mut taken_up = offsets(TimeOffset::Estimated(0.0));
        taken_up.resume([&[0.0, 0.0, 0.2, 0.0, f64::NAN], &[0.0, 0.0, 0.01, 0.0, 0.0]], [&[0.3, 0.01], &[0.01, 1e-3]]);
        assert_eq!(taken_up.time_offsets().0, [0.0, 0.0, 0.2, 0.0, 0.0]);
        assert_eq!(taken_up.calibrations().0, [0.0, 0.01]);
    }

    #[test]
    fn only_the_surest_error_of_a_keyframe_is_corrected() {
        let mut errors = offsets(TimeOffset::Estimated(0.0));
        let scores = |error| match error {
            DVL => score(0.2, 0.04),
            SCALE => score(0.03, 0.005),
            _ => [Score::default(); TERMS],
        };
        assert_eq!(errors.judge(scores, SECOND), Some(Correction { error: SCALE, by: 0.03, term: 1 }));
        assert_eq!((errors.of(SCALE), errors.of(DVL)), (0.03, 0.0));
    }

    #[test]
    fn a_calibration_that_leaves_the_innovations_large_is_not_the_cause() {
        let unexplained = Innovation { whitened: [0.0; 3], nis: 3.0, state_share: 0.0, slopes: Default::default() };
        for (readings, expected) in [(0, Some(0.03)), (500, None)] {
            let mut errors = offsets(TimeOffset::Estimated(0.0));
            (0..readings).for_each(|_| errors.observe(DVL, &unexplained, 1, 1.0));
            assert_eq!(judge(&mut errors, SCALE, score(0.03, 0.003)).map(|correction| correction.by), expected);
        }
    }

    #[test]
    fn each_error_has_one_sensor_and_slot() {
        for sensor in 0..STAMPS {
            for &(slot, error) in errors_of(sensor) {
                assert_eq!((sensor_of(error), slot), (sensor, usize::from(error >= STAMPS)));
                let owner = error.checked_sub(STAMPS).map_or(AIDING[sensor], |at| CALIBRATIONS[at].sensor());
                assert_eq!(owner, AIDING[sensor]);
            }
        }
        assert_eq!((0..STAMPS).map(|sensor| errors_of(sensor).len()).sum::<usize>(), ERRORS);
    }
}
