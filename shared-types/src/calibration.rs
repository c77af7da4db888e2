//! Systematic errors of the aiding sensors that an estimator may find while it navigates.

use crate::Sensor;

/// A constant of a sensor that may be off from what its configuration says.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Calibration {
    /// κ of the ranges: true sound speed is `1/(1 + κ)` of the assumed one.
    RangeScale,
    /// Relative scale error of the DVL's velocities.
    DvlScale,
}

/// Every one, in the order that messages and configurations have.
pub const CALIBRATIONS: [Calibration; 2] = [Calibration::RangeScale, Calibration::DvlScale];

impl Calibration {
    /// Its place in [`CALIBRATIONS`].
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Whose it is.
    pub const fn sensor(self) -> Sensor {
        match self {
            Calibration::RangeScale => Sensor::Lbl,
            Calibration::DvlScale => Sensor::Dvl,
        }
    }

    /// Its name in files and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Calibration::RangeScale => "range_scale",
            Calibration::DvlScale => "dvl_scale",
        }
    }

    /// The unit that a reader expects, and how many of it the SI unit of the field is.
    pub const fn shown_in(self) -> (&'static str, f64) {
        match self {
            Calibration::RangeScale | Calibration::DvlScale => ("%", 100.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_stands_at_its_index() {
        for (index, calibration) in CALIBRATIONS.into_iter().enumerate() {
            assert_eq!(calibration.index(), index, "{}", calibration.name());
        }
    }
}
