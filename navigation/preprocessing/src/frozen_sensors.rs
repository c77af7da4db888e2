//! Has a Doppler log, a compass or a pressure sensor frozen (F15, F16)?
//!
//! Not asked of one whose digits are coarse beside its own sigma: a vehicle that keeps its depth to the centimetre by a sensor that
//! says centimetres is told the same number for minutes, and rightly. Nor of ranges and fixes: moored buoys and receivers at rest
//! repeat themselves.

use shared_types::{Reading, Vehicle};

use crate::repetition::Repetition;

/// So many of the same in a row are a fault: with digits a tenth of a sigma apart, chance makes eight once in 10¹⁰ readings.
const FROZEN: u32 = 8;
/// A beginning, in readings: 10 to 20 s.
const BEGINNING: u32 = 100;
/// Finest step, in sigmas, beyond which digits are coarse.
const COARSE: f64 = 0.1;

/// The newest numbers of each sensor that can freeze.
#[derive(Clone, Debug)]
pub(crate) struct FrozenSensors {
    dvl: Repetition<3>,
    mcp: Repetition<1>,
    ps: Repetition<1>,
}

impl FrozenSensors {
    pub(crate) fn new() -> FrozenSensors {
        FrozenSensors {
            dvl: Repetition::new(FROZEN, BEGINNING),
            mcp: Repetition::new(FROZEN, BEGINNING),
            ps: Repetition::new(FROZEN, BEGINNING),
        }
    }

    /// Takes a reading in: whether it is one of a sensor that has frozen.
    pub(crate) fn is_frozen(&mut self, reading: &Reading, vehicle: &Vehicle) -> bool {
        let (is_frozen, finest, sigma) = match reading {
            Reading::Dvl { velocity_dvl } => {
                (self.dvl.is_frozen(velocity_dvl), self.dvl.finest_step(), vehicle.dvl.sigma)
            }
            Reading::Mcp { heading } => (self.mcp.is_frozen(&[*heading]), self.mcp.finest_step(), vehicle.mcp.sigma),
            Reading::Ps { depth } => (self.ps.is_frozen(&[*depth]), self.ps.finest_step(), vehicle.ps.sigma),
            _ => return false,
        };
        is_frozen && finest <= COARSE * sigma
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A thousand depths within two sigmas, in digits of `digit` m; refusals of 200 more at one depth.
    fn refused_at_rest(digit: f64) -> usize {
        let (mut frozen, vehicle) = (FrozenSensors::new(), Vehicle::default());
        let mut is_frozen =
            |depth: f64| frozen.is_frozen(&Reading::Ps { depth: (depth / digit).round() * digit }, &vehicle);
        let sigma = Vehicle::default().ps.sigma;
        assert!((0..1000).all(|step| !is_frozen(0.02 * sigma * f64::from(step * step % 101))));
        (0..200).filter(|_| is_frozen(30.0)).count()
    }

    #[test]
    fn fine_digits_that_stand_still_are_frozen_and_coarse_ones_are_not() {
        let sigma = Vehicle::default().ps.sigma;
        assert_eq!(refused_at_rest(1e-3 * sigma), 193);
        assert_eq!(refused_at_rest(0.5 * sigma), 0);
    }

    #[test]
    fn a_doppler_log_is_frozen_where_all_its_numbers_are() {
        let (mut frozen, vehicle) = (FrozenSensors::new(), Vehicle::default());
        let mut is_frozen = |velocity_dvl: [f64; 3]| frozen.is_frozen(&Reading::Dvl { velocity_dvl }, &vehicle);
        let noise = |step: i32| 1e-5 * f64::from(step * 7919 % 101);
        assert!((0..300).all(|step| !is_frozen([1.0 + noise(step), noise(step + 1), noise(step + 2)])));
        assert!((0..300).all(|step| !is_frozen([1.0, 0.0, noise(step)])), "one component varies");
        assert_eq!((0..20).filter(|_| is_frozen([1.0, 0.0, 0.5])).count(), 13);
    }
}
