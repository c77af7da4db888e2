//! One report per keyframe: what each factor said.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;

use crate::header::Header;
use crate::layout::message;

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
}

message! {
    /// What the newest keyframe holds.
    KeyframeReport, "ilns.KeyframeReport.1", schema 1 {
        /// Sender, order and times.
        header: Header,
        /// Solution that it belongs to.
        solution: u64,
        /// Data time of the keyframe, ns.
        t_keyframe: i64,
        /// Half the weighted sum of squares before and after the solve.
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
