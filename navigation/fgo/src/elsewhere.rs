//! Another place that one or two buoys may have been heard from (F25).
//!
//! On a straight course one buoy may lie to either hand, and all may be turned about it; two leave the mirror image in the line through
//! them. A start that is not known to better than that may end up on the wrong side, and only a turn tells. Then the ranges disagree
//! with the state, and too few of them come at a time to say where it is instead ([`nav_models::recovery`] needs three). But those of
//! the whole window do: its course, as inertial sensors and Doppler log have it, is shifted by d and turned by ψ about its end,
//!
//! ```text
//! min over d, ψ   Σ (|aₑ + d + R_z(ψ)(aᵢ − aₑ) − Bᵢ| − rᵢ)²/σᵢ² + ψ²/σ_ψ²
//! ```
//!
//! with aᵢ the transducer at the range rᵢ to the buoy at Bᵢ and aₑ the newest of them, from starting points all round the newest buoy.
//! As long as two places explain the ranges, the published covariance covers both; when the best is another than the present one and
//! no third explains them, the state is put there.

use nalgebra::{Matrix2, Matrix3, Rotation3, UnitQuaternion, Vector2, Vector3};
use nav_models::robust::chi2_999;
use nav_models::state::{ATTITUDE, NavState, POSITION};

use crate::kernels::Block;
use crate::rows::DIM;

/// The fewest ranges that tell a place.
const FEWEST: usize = 8;
/// Starting points round the buoy, and Gauss-Newton steps from each.
const BEARINGS: usize = 24;
const STEPS: usize = 12;
/// Places nearer to each other than this are one, m …
const SAME_PLACE: f64 = 10.0;
/// … and so are those which the ranges do not tell apart by as many sigmas, squared.
const SAME_VALLEY: f64 = 16.0;
/// χ² by which the best place has to be better than any other: chance is wrong once in 3e5.
const DECISIVE: f64 = 25.0;
/// A place that is known to no better than this is none, m.
const UNKNOWN_PLACE: f64 = 1e3;
/// The turn is known to no better than this at the beginning, rad: the search is no place for a division by nothing.
const TURN_LEAST: f64 = 1e-3;

/// One range, and where the state has its transducer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heard {
    /// Transducer, ENU, m.
    pub antenna_enu: Vector3<f64>,
    /// Buoy, ENU, m.
    pub buoy_enu: Vector3<f64>,
    /// m.
    pub range: f64,
    /// 1-sigma, m.
    pub sigma: f64,
}

/// Where the window's course may have to be put.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elsewhere {
    /// Newest transducer, about which it is turned: ENU, m.
    pivot: Vector3<f64>,
    /// d, east and north, m.
    shift: Vector2<f64>,
    /// ψ about up, rad.
    turn: f64,
    /// Of (d, ψ).
    covariance: Matrix3<f64>,
}

/// What the ranges say of the present place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Places {
    /// Too little, or none explains them.
    Unknown,
    /// There is no other.
    One,
    /// So far from it, m, there is another as good.
    Two(Vector2<f64>),
    /// It is wrong, and this one is right.
    Other(Elsewhere),
}

impl Places {
    /// Of ranges in order of time. `heading_sigma` in rad.
    pub fn of(heard: &[Heard], heading_sigma: f64) -> Places {
        let Some(newest) = heard.last().filter(|_| heard.len() >= FEWEST) else { return Places::Unknown };
        let heading_sigma = heading_sigma.max(TURN_LEAST);
        let depth = newest.antenna_enu.z - newest.buoy_enu.z;
        let radius = (newest.range * newest.range - depth * depth).max(0.0).sqrt();
        let mut found: [Option<(Elsewhere, f64)>; BEARINGS] = [None; BEARINGS];
        for (index, found) in found.iter_mut().enumerate() {
            let bearing = core::f64::consts::TAU * index as f64 / BEARINGS as f64;
            let start = newest.buoy_enu.xy() + Vector2::new(bearing.sin(), bearing.cos()) * radius;
            *found = minimise(heard, start - newest.antenna_enu.xy(), heading_sigma);
        }
        let here = squares(heard);
        let explained = chi2_999(heard.len());
        let found = || found.iter().flatten();
        let Some((best, least)) = found().min_by(|a, b| a.1.total_cmp(&b.1)) else { return Places::Unknown };
        let is_other = |place: &Elsewhere| place.is_apart_from(Vector2::zeros());
        let is_best = is_other(best) && here >= least + DECISIVE && *least <= explained;
        let is_only = found().all(|(place, chi2)| !place.is_apart_from(best.shift) || *chi2 >= least + DECISIVE);
        if is_best && is_only {
            return Places::Other(*best);
        }
        if here.min(*least) > explained {
            return Places::Unknown;
        }
        let rivals = found().filter(|(place, chi2)| is_other(place) && *chi2 < here.min(explained) + DECISIVE);
        let farthest = rivals.max_by(|a, b| a.0.shift.norm().total_cmp(&b.0.shift.norm()));
        farthest.map_or(Places::One, |(place, _)| Places::Two(place.shift))
    }
}

impl Elsewhere {
    /// Whether a shift leads to another place, not to another end of the same valley.
    fn is_apart_from(&self, shift: Vector2<f64>) -> bool {
        let between = self.shift - shift;
        let known: Matrix2<f64> = self.covariance.fixed_view::<2, 2>(0, 0).into();
        let distance = known.try_inverse().map_or(0.0, |weight| between.dot(&(weight * between)));
        between.norm() >= SAME_PLACE && distance >= SAME_VALLEY
    }

    /// The state there, and its covariance: that of the shift and the turn in place of what was believed of them.
    pub fn applied(&self, state: &NavState, covariance: &Block<DIM>) -> (NavState, Block<DIM>) {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.turn);
        let shift = Vector3::new(self.shift.x, self.shift.y, 0.0);
        let moved = NavState {
            position_enu: self.pivot + shift + turn * (state.position_enu - self.pivot),
            velocity_enu: turn * state.velocity_enu,
            q_enu_body: turn * state.q_enu_body,
            ..*state
        };
        let up_body = moved.q_enu_body.inverse() * Vector3::z();
        // What is replaced: east, north and the turn about up.
        let mut keeps = Block::<DIM>::identity();
        keeps[(POSITION, POSITION)] = 0.0;
        keeps[(POSITION + 1, POSITION + 1)] = 0.0;
        let mut tilt = keeps.fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE);
        tilt -= up_body * up_body.transpose();
        let mut by_place = nalgebra::SMatrix::<f64, DIM, 3>::zeros();
        by_place[(POSITION, 0)] = 1.0;
        by_place[(POSITION + 1, 1)] = 1.0;
        by_place.fixed_view_mut::<3, 1>(ATTITUDE, 2).copy_from(&up_body);
        let kept = keeps * covariance * keeps.transpose();
        (moved, kept + by_place * self.covariance * by_place.transpose())
    }
}

/// Σ of the squared residuals at the present place, in sigmas.
fn squares(heard: &[Heard]) -> f64 {
    let residual = |heard: &Heard| ((heard.antenna_enu - heard.buoy_enu).norm() - heard.range) / heard.sigma;
    heard.iter().map(|heard| residual(heard).powi(2)).sum()
}

/// The place that a starting shift leads to, and its χ².
fn minimise(heard: &[Heard], start: Vector2<f64>, heading_sigma: f64) -> Option<(Elsewhere, f64)> {
    let pivot = heard.last()?.antenna_enu;
    let mut at = Vector3::new(start.x, start.y, 0.0);
    let mut normal = Matrix3::zeros();
    let mut chi2 = f64::INFINITY;
    for step in 0..=STEPS {
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), at.z);
        let prior = 1.0 / (heading_sigma * heading_sigma);
        normal = Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, prior));
        let mut right = Vector3::new(0.0, 0.0, -at.z * prior);
        chi2 = at.z * at.z * prior;
        for range in heard {
            let from_pivot = rotation * (range.antenna_enu - pivot);
            let from_buoy = pivot + Vector3::new(at.x, at.y, 0.0) + from_pivot - range.buoy_enu;
            let distance = from_buoy.norm();
            let direction = from_buoy / distance.max(1e-6);
            let residual = (distance - range.range) / range.sigma;
            let by_turn = direction.dot(&Vector3::z().cross(&from_pivot));
            let row = Vector3::new(direction.x, direction.y, by_turn) / range.sigma;
            normal += row * row.transpose();
            right -= row * residual;
            chi2 += residual * residual;
        }
        if step == STEPS {
            break;
        }
        at += normal.cholesky()?.solve(&right);
    }
    let covariance = normal.try_inverse()?;
    let is_place = (at.sum() + chi2 + covariance.sum()).is_finite();
    let is_known = covariance[(0, 0)] + covariance[(1, 1)] < UNKNOWN_PLACE * UNKNOWN_PLACE;
    (is_place && is_known).then_some((Elsewhere { pivot, shift: at.xy(), turn: at.z, covariance }, chi2))
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUOY: Vector3<f64> = Vector3::new(0.0, 300.0, 0.0);
    const SIGMA: f64 = 0.3;

    /// One range a second of a vehicle on its way north, 150 m to the east of the buoy, which turns to the east after `straight` of
    /// them; the state has it `off` of there, and ranges have the error `noise`.
    fn course(straight: usize, turned: usize, off: Vector2<f64>, noise: impl Fn(usize) -> f64) -> Vec<Heard> {
        let mut at = Vector3::new(150.0, 380.0, -20.0);
        (0..straight + turned)
            .map(|index| {
                at += if index < straight { Vector3::y() } else { Vector3::x() } * 1.2;
                let range = (at - BUOY).norm() + noise(index);
                let antenna_enu = at + Vector3::new(off.x, off.y, 0.0);
                Heard { antenna_enu, buoy_enu: BUOY, range, sigma: SIGMA }
            })
            .collect()
    }

    fn noise(index: usize) -> f64 {
        SIGMA * (index as f64 * 2.4).sin()
    }

    const MIRRORED: Vector2<f64> = Vector2::new(-300.0, 0.0);

    #[test]
    fn on_a_straight_course_one_buoy_may_lie_to_either_hand() {
        for off in [Vector2::zeros(), MIRRORED] {
            let Places::Two(shift) = Places::of(&course(20, 0, off, noise), 0.03) else { panic!("{off}") };
            let expected = if off.x == 0.0 { -300.0 } else { 300.0 };
            assert!((shift.x - expected).abs() < 60.0 && shift.y.abs() < 60.0, "{off}: {shift}");
        }
    }

    #[test]
    fn a_turn_tells() {
        assert_eq!(Places::of(&course(12, 8, Vector2::zeros(), noise), 0.03), Places::One);
        let heard = course(12, 8, MIRRORED, noise);
        let Places::Other(place) = Places::of(&heard, 0.03) else { panic!("it is on the wrong side") };
        assert!((place.shift + MIRRORED).norm() < 30.0, "{place:?}");
        let known = place.covariance;
        let error = Vector3::new(place.shift.x - 300.0, place.shift.y, place.turn);
        let nees = error.dot(&(known.try_inverse().expect("it is known") * error));
        assert!(nees < 16.0, "{nees}");
    }

    #[test]
    fn ranges_that_no_place_explains_move_nobody() {
        let wild = course(12, 8, MIRRORED, |index| if index % 5 == 0 { 40.0 } else { noise(index) });
        assert_eq!(Places::of(&wild, 0.03), Places::Unknown);
        assert_eq!(Places::of(&course(4, 3, MIRRORED, noise), 0.03), Places::Unknown, "too few");
        assert_eq!(Places::of(&[], 0.03), Places::Unknown);
        let none = course(12, 8, MIRRORED, |_| f64::NAN);
        assert_eq!(Places::of(&none, 0.03), Places::Unknown);
    }

    #[test]
    fn the_state_is_put_there_with_what_is_known_of_the_place() {
        let heard = course(12, 8, MIRRORED, noise);
        let Places::Other(place) = Places::of(&heard, 0.03) else { panic!("it is on the wrong side") };
        let state = NavState { position_enu: heard[19].antenna_enu, ..NavState::identity() };
        let (moved, covariance) = place.applied(&state, &(Block::identity() * 1e-4));
        assert!((moved.position_enu.xy() - heard[19].antenna_enu.xy() - place.shift).norm() < 1e-9);
        assert_eq!(moved.position_enu.z, state.position_enu.z);
        assert!(covariance.cholesky().is_some(), "{covariance}");
        assert_eq!((covariance[(0, 0)], covariance[(2, 2)]), (place.covariance[(0, 0)], 1e-4));
        assert_eq!(covariance[(0, ATTITUDE + 2)], place.covariance[(0, 2)], "a place that is turned about the buoy");
    }
}
