//! One report per keyframe: what each factor said.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;

use crate::header::Header;
use crate::layout::message;
use crate::reject::RejectReason;
use crate::time::Time;

/// Factors that one report holds; further ones are counted, not listed.
pub const FACTORS_MAX: usize = 40;

/// One factor of the newest interval.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[repr(C)]
pub struct FactorReport {
    /// Data time at which the reading was valid, ns.
    pub t_valid: i64,
    /// Sensor number.
    pub sensor: u32,
    /// Rows of the residual.
    pub rows: u32,
    /// Buoy number for a range, else 0.
    pub buoy: u32,
    /// 0: used; otherwise 1 + the number of the [`crate::RejectReason`].
    pub refused: u32,
    /// Innovation whitened by its own covariance, predicted minus measured.
    pub whitened: [f64; 3],
    /// Squared normalised innovation.
    pub nis: f64,
    /// Robust weight in use.
    pub weight: f64,
    /// What its sensor's gate lets through, in sigmas: of the whitened innovation of a range (too long, too short), else of
    /// the root of `nis`. Twice 0: the sensor has no gate.
    pub gate: [f64; 2],
}

message! {
    /// What the newest keyframe holds.
    KeyframeReport, "ilns.KeyframeReport.2", schema 2 {
        /// Sender, order and times.
        header: Header,
        /// Solution that it belongs to.
        solution: u64,
        /// Data time of the keyframe, ns.
        t_keyframe: i64,
        /// Half the robust sum of squares of the measurements in the window before and after the solve.
        cost: [f64; 2],
        /// Iterations.
        iterations: u32,
        /// Keyframes in the window.
        keyframes: u32,
        /// Entries of `factors` in use.
        factor_count: u32,
        /// Factors that did not fit.
        factors_left_out: u32,
        /// The factors.
        factors: [FactorReport; FACTORS_MAX],
    }
}

impl KeyframeReport {
    /// Of a keyframe that holds nothing yet.
    pub fn empty() -> KeyframeReport {
        KeyframeReport {
            header: Header::default(),
            solution: 0,
            t_keyframe: 0,
            cost: [0.0; 2],
            iterations: 0,
            keyframes: 0,
            factor_count: 0,
            factors_left_out: 0,
            factors: [FactorReport::default(); FACTORS_MAX],
        }
    }

    /// Lists a factor, or counts it where the list is full.
    pub fn list(&mut self, factor: FactorReport) {
        match self.factors.get_mut(self.factor_count as usize) {
            Some(place) => {
                *place = factor;
                self.factor_count += 1;
            }
            None => self.factors_left_out += 1,
        }
    }

    /// Lists a reading that was refused before it could be judged.
    pub fn list_refused(&mut self, t: Time, kind: u32, reason: RejectReason) {
        let refused = 1 + reason as u32;
        self.list(FactorReport { t_valid: t.0, sensor: kind, refused, ..FactorReport::default() });
    }
}
