//! First position: a fix less its lever arm, else ranges of one epoch and the depth, else the last place known and the depth. It is the guess from which, and the choice of
//! readings with which, [`Adjustment`] finds the position at the keyframe.
//!
//! Ranges to buoys at one height have two solutions, one the mirror of the other. Gauss-Newton starts on both sides, the
//! better residual wins and, where they tie, the one under the buoys. The offset that an epoch shares is a fourth unknown with
//! its prior, so that raw ranges (σ_d = 0), differences (σ_d = ∞, at least four buoys) and what lies between are one thing.
//! Transponders that are asked one after the other have an epoch each: raw ranges are taken from the newest of every buoy, each
//! along the way that the vehicle has gone since.

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};
use shared_types::{Duration, Reading, Time};

use super::attitude::Velocity;
use super::{Initialiser, READING_AGE_MAX, newest_at};
use crate::world::WorldModel;

/// 1-sigma of a position of which nothing is known yet, m: it takes nothing from what a reading says of it.
const UNKNOWN_POSITION_SIGMA: f64 = 1e4;
/// A position that is worse than this tells nothing, m, 1-sigma of an axis.
pub(super) const WORST_SIGMA: f64 = 500.0;
/// Vertical sigma where only the horizontal was reported, m.
const UNKNOWN_HEIGHT_SIGMA: f64 = 20.0;
/// Gauss-Newton ends here.
const ITERATIONS: usize = 30;
const CONVERGED: f64 = 1e-6;
/// The range of a buoy that is asked in turn stands for so long.
const TURN: Duration = Duration(10_000_000_000);
/// What a velocity that the DVL saw may be off by while it is held over some seconds, m/s.
const TURNING: f64 = 0.3;
/// Sigmas by which a fix may be off what else is known.
const CREDIBLE: f64 = 5.0;
/// What a vehicle may go between two fixes, m/s.
const FASTEST: f64 = 5.0;
/// Antenna and pressure port may be so far apart, waves between them, m.
const BETWEEN_SENSORS: f64 = 3.0;
/// Ranges kept.
const RANGES_KEPT: usize = 32;
/// Sum of squares per surplus row beyond which ranges do not meet in a point: a wrong range, a wrong buoy.
const WORST_COST: f64 = 25.0;

/// One range.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range {
    pub(super) t: Time,
    pub(super) buoy: u32,
    pub(super) epoch: u32,
    pub(super) range: f64,
    pub(super) buoy_enu: Vector3<f64>,
    pub(super) buoy_sigma: f64,
}

/// Ranges of the newest epoch, and the newest of every buoy that is not in it.
#[derive(Clone, Debug, Default)]
pub(super) struct Ranges(Vec<Range>);

impl Ranges {
    pub(super) fn hear(&mut self, range: Range) {
        self.0.retain(|known| known.epoch == range.epoch || known.buoy != range.buoy && range.t - known.t <= TURN);
        if self.0.len() < RANGES_KEPT {
            self.0.push(range);
        }
    }

    /// Those that tell the place at a keyframe, which may lie within their epoch: at least `needed` of one epoch, else, if
    /// `may_mix`, of several.
    fn at(&self, t_keyframe: Time, needed: usize, may_mix: bool) -> Vec<Range> {
        let newest = self.0.last().map(|range| range.epoch);
        let is_near = |range: &&Range| (range.t - t_keyframe).abs() <= READING_AGE_MAX;
        let of_epoch = self.0.iter().filter(|range| Some(range.epoch) == newest).filter(is_near);
        if of_epoch.clone().count() >= needed || !may_mix {
            return of_epoch.copied().collect();
        }
        let is_of_turn = |range: &&Range| is_near(range) || range.t <= t_keyframe && t_keyframe - range.t <= TURN;
        self.0.iter().filter(is_of_turn).copied().collect()
    }
}

/// Antenna and sigmas of a satellite fix.
type Fixed = (Time, (Vector3<f64>, Vector3<f64>));

struct Fix {
    position_enu: Vector3<f64>,
    covariance: Matrix3<f64>,
    cost: f64,
}

/// Where the vehicle is, roughly, and what says so.
pub(super) struct Place {
    pub(super) position_enu: Vector3<f64>,
    /// What is known without `readings`.
    pub(super) covariance: Matrix3<f64>,
    pub(super) readings: Vec<(Time, Reading)>,
}

impl Initialiser {
    pub(super) fn position_at(
        &self,
        t_keyframe: Time,
        r_enu_body: &Matrix3<f64>,
        velocity: &Velocity,
        world: &WorldModel,
    ) -> Option<Place> {
        let initial = &self.config.vehicle.initial;
        if let Some(position) = initial.position_enu {
            let covariance = Matrix3::identity() * initial.sigma_position.powi(2);
            return Some(Place { position_enu: Vector3::from(position), covariance, readings: Vec::new() });
        }
        let depth = newest_at(&self.heard.ps, t_keyframe).map(|&(t, depth)| (t, Reading::Ps { depth }));
        let fix = newest_at(&self.heard.gnss, t_keyframe).filter(|fix| self.is_credible(fix, world));
        if let Some((t, (antenna, sigma))) = fix {
            let lever_arm = Vector3::from(self.config.vehicle.gnss.lever_arm_body);
            let height = if sigma.z.is_finite() { UNKNOWN_POSITION_SIGMA } else { UNKNOWN_HEIGHT_SIGMA };
            let sigmas = Vector3::new(UNKNOWN_POSITION_SIGMA, UNKNOWN_POSITION_SIGMA, height);
            let axes = world.frame.local_axes_at(antenna);
            let reading = Reading::Gnss { antenna_enu: (*antenna).into(), sigma_enu: (*sigma).into() };
            return Some(Place {
                position_enu: antenna - r_enu_body * lever_arm,
                covariance: axes * Matrix3::from_diagonal(&sigmas.component_mul(&sigmas)) * axes.transpose(),
                readings: depth.into_iter().chain([(*t, reading)]).collect(),
            });
        }
        let has_common_offset = self.config.navigator.lbl_common_offset_sigma > 0.0;
        let needed = if has_common_offset { 4 } else { 3 };
        let ranges = self.heard.ranges.at(t_keyframe, needed, !has_common_offset);
        let meeting = (ranges.len() >= needed)
            .then(|| self.multilaterate(&ranges, t_keyframe, r_enu_body, velocity, world))
            .flatten();
        let Some(fix) = meeting else {
            let aged = self.aged(t_keyframe, world)?;
            return Some(Place {
                position_enu: aged.position_enu,
                covariance: aged.position_cov,
                readings: depth.into_iter().collect(),
            });
        };
        let ranges = ranges.iter().map(|range| {
            let Range { t, buoy, epoch, range, buoy_enu, buoy_sigma } = *range;
            (t, Reading::Lbl { buoy, epoch, range, buoy_enu: buoy_enu.into(), buoy_sigma, is_moored: false })
        });
        Some(Place {
            position_enu: fix.position_enu,
            covariance: Matrix3::from_diagonal_element(UNKNOWN_POSITION_SIGMA.powi(2)),
            readings: depth.into_iter().chain(ranges).collect(),
        })
    }

    /// Whether a run may begin at a fix: a wild one would be believed for long. One that agrees with the fix before
    /// it may, and one whose height agrees with the depth; so may one that nothing speaks against.
    fn is_credible(&self, (t, (antenna, sigma)): &Fixed, world: &WorldModel) -> bool {
        let before = self.heard.gnss.iter().filter(|(earlier, _)| earlier < t).max_by_key(|(earlier, _)| *earlier);
        let agrees = before.map(|(earlier, (other, other_sigma))| {
            let way = FASTEST * (*t - *earlier).as_seconds();
            let off = antenna - other;
            // The sigma of a height that was not reported is infinite.
            (0..3).all(|axis| off[axis].abs() <= CREDIBLE * sigma[axis].hypot(other_sigma[axis]) + way)
        });
        if agrees == Some(true) {
            return true;
        }
        let depth = newest_at(&self.heard.ps, *t).map(|(_, depth)| *depth).filter(|_| sigma.z.is_finite());
        let off =
            depth.map(|depth| world.frame.height_at(antenna) - (self.config.vehicle.frame.surface_height - depth));
        match off {
            Some(off) => off.abs() <= CREDIBLE * sigma.z + BETWEEN_SENSORS,
            None => agrees.is_none(),
        }
    }

    fn multilaterate(
        &self,
        ranges: &[Range],
        t_keyframe: Time,
        r_enu_body: &Matrix3<f64>,
        velocity: &Velocity,
        world: &WorldModel,
    ) -> Option<Fix> {
        let middle = ranges.iter().map(|range| range.buoy_enu).sum::<Vector3<f64>>() / ranges.len() as f64;
        let reach = ranges.iter().map(|range| range.range).fold(f64::INFINITY, f64::min);
        let mut best: Option<Fix> = None;
        // Below first: a tie keeps it.
        for side in [-0.5, 0.5] {
            let start = middle + Vector3::z() * (side * reach);
            if let Some(fix) = self.solve(ranges, &start, t_keyframe, r_enu_body, velocity, world)
                && best.as_ref().is_none_or(|other| fix.cost < other.cost - 1e-6 * (1.0 + other.cost))
            {
                best = Some(fix);
            }
        }
        best.filter(|fix| fix.covariance.diagonal().iter().all(|v| *v <= WORST_SIGMA * WORST_SIGMA))
    }

    /// Gauss-Newton for (position, common offset) from one start.
    fn solve(
        &self,
        ranges: &[Range],
        start: &Vector3<f64>,
        t_keyframe: Time,
        r_enu_body: &Matrix3<f64>,
        velocity: &Velocity,
        world: &WorldModel,
    ) -> Option<Fix> {
        let vehicle = &self.config.vehicle;
        let transducer = r_enu_body * Vector3::from(vehicle.lbl.lever_arm_body);
        let port = r_enu_body * Vector3::from(vehicle.ps.lever_arm_body);
        let depth = newest_at(&self.heard.ps, t_keyframe).map(|(_, depth)| *depth);
        let offset_sigma = self.config.navigator.lbl_common_offset_sigma;
        // Raw ranges: an offset held at zero, to a micrometre.
        let offset_information = 1.0 / offset_sigma.max(1e-6).powi(2);

        let speed_sigma = match velocity.readings.is_empty() {
            true => velocity.covariance.diagonal().max().sqrt(),
            false => TURNING,
        };

        let (mut position, mut offset) = (*start, 0.0);
        for _ in 0..ITERATIONS {
            let mut normal = Matrix4::zeros();
            let mut gradient = Vector4::zeros();
            let mut cost = 0.0;
            let mut add = |row: Vector4<f64>, residual: f64, information: f64| {
                normal += row * row.transpose() * information;
                gradient += row * (residual * information);
                cost += residual * residual * information;
            };
            for range in ranges {
                let dt = (range.t - t_keyframe).as_seconds();
                let from_buoy = position + velocity.velocity_enu * dt + transducer - range.buoy_enu;
                let distance = from_buoy.norm().max(f64::MIN_POSITIVE);
                let direction = from_buoy / distance;
                // Residual predicted − measured, with the measured range long by the offset (r = h − z ~ d).
                let variance = vehicle.lbl.sigma.powi(2) + range.buoy_sigma.powi(2) + (speed_sigma * dt).powi(2);
                add(direction.push(-1.0), distance - range.range - offset, 1.0 / variance);
            }
            add(Vector4::w(), offset, offset_information);
            if let Some(depth) = depth {
                let at = position + port;
                let residual = vehicle.frame.surface_height - world.frame.height_at(&at) - depth;
                add((-world.frame.up_at(&at)).push(0.0), residual, 1.0 / vehicle.ps.sigma.powi(2));
            }
            let covariance = normal.try_inverse()?;
            let step = covariance * gradient;
            if !step.iter().all(|x| x.is_finite()) {
                return None;
            }
            position -= step.xyz();
            offset -= step.w;
            if step.norm() < CONVERGED {
                let surplus = ranges.len() + usize::from(depth.is_some());
                let surplus = surplus.saturating_sub(3).max(1) as f64;
                let covariance = covariance.fixed_view::<3, 3>(0, 0).into_owned();
                return (cost <= WORST_COST * surplus).then_some(Fix { position_enu: position, covariance, cost });
            }
        }
        None
    }
}
