//! Who may be elsewhere, or turned, without knowing it (F25).
//!
//! One or two buoys and a start that is not known leave several places ([`Places`]), and a single buoy without a compass leaves every
//! place round it. The ranges of the window are remembered and asked now and then; the published covariance covers what they leave.

use nalgebra::{Vector2, Vector3};
use nav_geometry::wgs84::EARTH_RATE;
use nav_models::recovery::{Checked, NEAR_KEYFRAME};
use nav_models::state::{ATTITUDE, NavState, POSITION};
use shared_types::{Config, Reading, Sensor, Time};

use crate::elsewhere::{Elsewhere, Heard, Places};
use crate::kernels::{Block, BlockVector};
use crate::rows::DIM;
use crate::window::Window;

/// A start that is known to so many m per axis has but one place.
const UNKNOWN_START: f64 = 10.0;
/// Buoys in one epoch that leave but one place.
const ENOUGH_BUOYS: usize = 3;
/// Keyframes from one look to the next.
const EVERY: u32 = 4;
/// Ranges that nothing explains by then will not be explained.
const UNDECIDED_AT_MOST: u32 = 30;
/// Ranges that are remembered.
const REMEMBERED: usize = 32;

/// Looks for other places for as long as there may be one.
#[derive(Clone, Debug)]
pub struct Alternatives {
    is_open: bool,
    /// 1-sigma per axis of the position at the start, m.
    sigma_at_start: f64,
    ranges: Vec<(Time, Reading)>,
    heard: Vec<Heard>,
    keyframes: u32,
    /// Nothing is known of other places yet.
    is_undecided: bool,
    /// How far away there is another place as good.
    rival: Option<Vector2<f64>>,
    /// 1-sigma at the start, rad.
    heading_at_start: f64,
    /// Nobody tells the heading: an instrument that does not feel which way the Earth turns, no compass, and never more than one buoy.
    is_heading_untold: bool,
    /// The only buoy that has been heard, where nobody tells the heading: its number and where it is.
    centre: Option<(u32, Vector3<f64>)>,
}

impl Alternatives {
    /// For a start as the configuration has it.
    pub fn new(config: &Config) -> Alternatives {
        let sigma_at_start = config.vehicle.initial.sigma_position;
        let heading_at_start = config.vehicle.initial.sigma_attitude[2];
        Alternatives {
            is_open: sigma_at_start >= UNKNOWN_START,
            sigma_at_start,
            ranges: Vec::with_capacity(REMEMBERED),
            heard: Vec::with_capacity(REMEMBERED),
            keyframes: 0,
            is_undecided: true,
            rival: None,
            heading_at_start,
            is_heading_untold: config.vehicle.imu.gyro_bias_sigma > EARTH_RATE * heading_at_start,
            centre: None,
        }
    }

    /// The state was taken up from an earlier run: what it knew stands for the start.
    pub fn resume(&mut self, state: &NavState, covariance: &Block<DIM>) {
        self.sigma_at_start = covariance[(POSITION, POSITION)].max(covariance[(POSITION + 1, POSITION + 1)]).sqrt();
        self.heading_at_start = heading_variance(state, covariance).sqrt();
        self.is_open = self.sigma_at_start >= UNKNOWN_START;
        self.is_undecided = false;
    }

    /// Takes in what was measured up to a keyframe. Whoever hears satellites or three buoys has but one place.
    pub fn hear(&mut self, measured: &[Checked]) {
        if !self.is_open {
            return;
        }
        let mut together = (0_u32, 0_usize);
        for (measurement, reading) in measured {
            match *reading {
                Reading::Lbl { buoy, epoch, buoy_enu, .. } => {
                    self.is_heading_untold &= self.centre.is_none_or(|(only, _)| only == buoy);
                    self.centre = Some((buoy, Vector3::from(buoy_enu))).filter(|_| self.is_heading_untold);
                    together = if together.0 == epoch { (epoch, together.1 + 1) } else { (epoch, 1) };
                    self.is_open &= together.1 < ENOUGH_BUOYS;
                    if self.ranges.len() == REMEMBERED {
                        self.ranges.remove(0);
                    }
                    if (measurement.t_valid() - measurement.t_keyframe()).abs() <= NEAR_KEYFRAME {
                        self.ranges.push((measurement.t_keyframe(), *reading));
                    }
                }
                Reading::Mcp { .. } => self.is_heading_untold = false,
                _ => self.is_open &= measurement.sensor() != Some(Sensor::Gnss),
            }
        }
        self.centre = self.centre.filter(|_| self.is_heading_untold && self.is_open);
        self.rival = self.rival.filter(|_| self.is_open);
    }

    /// The place to go to, where that of `window` is wrong. `covariance` is that of its newest state.
    pub fn look(&mut self, window: &Window, covariance: &Block<DIM>, config: &Config) -> Option<Elsewhere> {
        self.keyframes += 1;
        if !self.is_open || !self.keyframes.is_multiple_of(EVERY) {
            return None;
        }
        let heading_sigma = heading_variance(&window.nodes().back()?.state, covariance).sqrt();
        self.heard.clear();
        for (t_keyframe, reading) in &self.ranges {
            let Reading::Lbl { range, buoy_enu, buoy_sigma, .. } = *reading else { continue };
            let Some(index) = window.index_at(*t_keyframe) else { continue };
            let state = &window.nodes()[index].state;
            let lever_arm = Vector3::from(config.vehicle.lbl.lever_arm_body);
            self.heard.push(Heard {
                antenna_enu: state.position_enu + state.q_enu_body * lever_arm,
                buoy_enu: Vector3::from(buoy_enu),
                range,
                sigma: config.vehicle.lbl.sigma.hypot(buoy_sigma),
            });
        }
        let places = Places::of(&self.heard, heading_sigma.max(self.heading_by_start()));
        self.is_undecided &= places == Places::Unknown && self.keyframes < UNDECIDED_AT_MOST;
        self.rival = match places {
            Places::Unknown => self.rival,
            Places::Two(shift) => Some(shift),
            Places::One | Places::Other(_) => None,
        };
        if let Places::Other(place) = places { Some(place) } else { None }
    }

    /// 1-sigma of the heading, rad, where nothing but the start tells it.
    fn heading_by_start(&self) -> f64 {
        if self.centre.is_some() { self.heading_at_start } else { 0.0 }
    }

    /// Makes a covariance cover the other place, as long as there is one as good: in that direction the position is not known any
    /// better than at the start, and in none as long as nothing is known. And all may be turned about a single buoy by what the heading
    /// was unknown at the start; the filter believes to know better, since it linearises each range where it believes to be.
    pub fn cover(&self, state: &NavState, covariance: &mut Block<DIM>) {
        if !self.is_open {
            return;
        }
        if let Some((_, centre)) = self.centre {
            let up_body = state.q_enu_body.inverse() * Vector3::z();
            let known = heading_variance(state, covariance);
            let mut turned = BlockVector::<DIM>::zeros();
            turned.fixed_rows_mut::<3>(POSITION).copy_from(&Vector3::z().cross(&(state.position_enu - centre)));
            turned.fixed_rows_mut::<3>(ATTITUDE).copy_from(&up_body);
            *covariance += turned * turned.transpose() * (self.heading_at_start.powi(2) - known).max(0.0);
        }
        let mut position = covariance.fixed_view_mut::<2, 2>(POSITION, POSITION);
        if let Some(shift) = self.rival {
            let covered = shift * (self.sigma_at_start / shift.norm()).min(core::f64::consts::FRAC_1_SQRT_2);
            position += covered * covered.transpose();
        } else if self.is_undecided {
            for axis in 0..2 {
                position[(axis, axis)] = position[(axis, axis)].max(self.sigma_at_start * self.sigma_at_start);
            }
        }
    }
}

/// Variance of the turn about up, rad².
fn heading_variance(state: &NavState, covariance: &Block<DIM>) -> f64 {
    let up_body = state.q_enu_body.inverse() * Vector3::z();
    (covariance.fixed_view::<3, 3>(ATTITUDE, ATTITUDE) * up_body).dot(&up_body).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Measurement;

    const ELSEWHERE: Vector2<f64> = Vector2::new(-300.0, 0.0);

    fn alternatives(sigma_position: f64) -> Alternatives {
        let mut config = Config::default();
        config.vehicle.initial.sigma_position = sigma_position;
        Alternatives::new(&config)
    }

    fn covered(alternatives: &Alternatives) -> [f64; 3] {
        let mut covariance = Block::zeros();
        alternatives.cover(&NavState::identity(), &mut covariance);
        [covariance[(0, 0)], covariance[(1, 1)], covariance[(2, 2)]].map(f64::sqrt)
    }

    #[test]
    fn the_sigma_covers_both_places_and_is_no_larger_than_at_the_start() {
        let mut alternatives = alternatives(150.0);
        assert_eq!(covered(&alternatives), [150.0, 150.0, 0.0], "nothing is known yet");
        let mut resumed = alternatives.clone();
        resumed.resume(&NavState::identity(), &(Block::identity() * 400.0));
        assert_eq!(covered(&resumed), [0.0; 3], "the covariance that was taken up is its own");
        resumed.rival = Some(ELSEWHERE);
        assert_eq!(covered(&resumed), [20.0, 0.0, 0.0], "no larger than it was");
        resumed.resume(&NavState::identity(), &Block::identity());
        assert_eq!(covered(&resumed), [0.0; 3], "the run before knew the place");
        alternatives.rival = Some(ELSEWHERE);
        assert_eq!(covered(&alternatives), [150.0, 0.0, 0.0]);
        alternatives.rival = Some(Vector2::new(0.0, 100.0));
        assert!((covered(&alternatives)[1] - 100.0 / 2.0_f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn a_known_start_three_buoys_or_a_satellite_fix_leave_but_one_place() {
        assert!(!alternatives(3.0).is_open);
        let checked = |reading: Reading| (Measurement::new(Time(0), Time(0), &reading), reading);
        let range = |buoy: u32| {
            checked(Reading::Lbl { buoy, epoch: 1, range: 100.0, buoy_enu: [0.0; 3], buoy_sigma: 0.0, is_moored: true })
        };
        let mut few = alternatives(100.0);
        few.rival = Some(ELSEWHERE);
        few.hear(&[range(1), range(2)]);
        assert!(few.is_open && few.rival.is_some());
        few.hear(&[range(1), range(2), range(3)]);
        assert_eq!((few.is_open, few.rival), (false, None));
        let mut surfaced = alternatives(100.0);
        surfaced.hear(&[checked(Reading::Gnss { antenna_enu: [0.0; 3], sigma_enu: [1.0; 3] })]);
        assert_eq!(covered(&surfaced), [0.0; 3]);
    }

    #[test]
    fn all_may_be_turned_about_a_single_buoy_until_somebody_tells_the_heading() {
        let checked = |reading: Reading| (Measurement::new(Time(0), Time(0), &reading), reading);
        let range = |buoy: u32, epoch: u32| {
            checked(Reading::Lbl {
                buoy,
                epoch,
                range: 100.0,
                buoy_enu: [0.0, -100.0, 0.0],
                buoy_sigma: 0.0,
                is_moored: true,
            })
        };
        let mut single = alternatives(100.0);
        (single.is_undecided, single.heading_at_start) = (false, 0.1);
        assert_eq!(covered(&single), [0.0; 3], "nothing has been heard");
        single.hear(&[range(7, 1), range(7, 2)]);
        let mut covariance = Block::zeros();
        covariance[(ATTITUDE + 2, ATTITUDE + 2)] = 0.06 * 0.06;
        single.cover(&NavState::identity(), &mut covariance);
        assert!((covariance[(ATTITUDE + 2, ATTITUDE + 2)] - 0.01).abs() < 1e-12, "of the heading what is missing");
        assert!((covariance[(POSITION, POSITION)] - 64.0).abs() < 1e-9, "100 m from the buoy, 0.08 rad");
        assert!((covariance[(POSITION, ATTITUDE + 2)] + 0.64).abs() < 1e-9, "to the left, to the west");
        for tells in [range(8, 3), checked(Reading::Mcp { heading: 0.0 })] {
            let mut told = single.clone();
            told.hear(&[tells]);
            assert_eq!(covered(&told), [0.0; 3]);
            told.hear(&[range(7, 4)]);
            assert_eq!(covered(&told), [0.0; 3], "for good");
        }
    }
}
