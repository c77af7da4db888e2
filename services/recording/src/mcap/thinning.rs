//! Which of the published estimates an MCAP holds.

use shared_types::{Duration, Mode, NavEstimate, Time};

/// Between two estimates of the file, data time: 20 Hz, what a view can show.
const PERIOD: Duration = Duration(50_000_000);

/// Passes twenty estimates a second, and the first of each solution: those say when a correction reached the published
/// estimate, which is all that a replay needs to repeat every estimate in between.
///
/// Two of them in a row pass what one passes.
#[derive(Clone, Copy, Debug, Default)]
pub struct EstimateThinning {
    last: Option<(Time, u64)>,
}

impl EstimateThinning {
    /// Whether the file wants this one. INITIALISING ones and those that are no numbers are passed over.
    pub fn wants(&mut self, estimate: &NavEstimate) -> bool {
        if estimate.mode() == Mode::Initialising || !is_finite(estimate) {
            return false;
        }
        let t = Time(estimate.header.t_valid);
        let is_wanted =
            self.last.is_none_or(|(last, solution)| t < last || t - last >= PERIOD || solution != estimate.solution);
        if is_wanted {
            self.last = Some((t, estimate.solution));
        }
        is_wanted
    }
}

fn is_finite(estimate: &NavEstimate) -> bool {
    let groups: [&[f64]; 4] =
        [&estimate.position_enu, &estimate.q_enu_body, &estimate.position_cov, &estimate.lat_lon_h];
    groups.into_iter().flatten().all(|value| value.is_finite())
}
