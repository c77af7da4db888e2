//! Anchored measurements: what the preprocessor hands to an estimator, on the wire and in memory.
//!
//! `t_valid − t_keyframe` is the signed time offset of the reading from the keyframe that it is tied to: positive is
//! reached by forward preintegration, negative by backward. A number on the bus is checked before it becomes a
//! [`Reading`].

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;

use crate::header::Header;
use crate::layout::message;
use crate::sensor::Sensor;
use crate::time::Time;

message! {
    /// A checked, gated, anchored measurement in SI units and the ENU frame.
    ///
    /// Order on the channel: IMU samples as they come; then, for each keyframe, the readings tied to it or to its
    /// predecessor, the ranges of its epoch last, and the keyframe itself as the closing bracket.
    Measurement, "ilns.Measurement.2", schema 2 {
        /// Sender, order and times.
        header: Header,
        /// Keyframe that the reading is tied to, data time in ns (equals `t_valid` for IMU samples and keyframes).
        t_keyframe: i64,
        /// Which reading: `Sensor` number, or [`Measurement::KEYFRAME`].
        kind: u32,
        /// LBL epoch counter; 0 for others.
        epoch: u32,
        /// By kind; see [`Reading`].
        values: [f64; 12],
    }
}

/// A measurement's content, checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reading {
    /// IMU sample: rad/s and m/s², raw, body frame.
    Imu {
        /// Angular rate, rad/s.
        gyro_body: [f64; 3],
        /// Specific force, m/s².
        accel_body: [f64; 3],
    },
    /// One range of an epoch.
    Lbl {
        /// Number of the buoy.
        buoy: u32,
        /// Epoch counter: ranges with equal epochs share one common offset.
        epoch: u32,
        /// Measured slant range, m.
        range: f64,
        /// Buoy at the emission instant, m.
        buoy_enu: [f64; 3],
        /// 1-sigma per axis of that position, m.
        buoy_sigma: f64,
        /// Whether it is moored: what its position is off by is the same in all its ranges.
        is_moored: bool,
    },
    /// Satellite fix.
    Gnss {
        /// Antenna, m, exact ENU through ECEF.
        antenna_enu: [f64; 3],
        /// 1-sigma along local east, north, up at the fix, m; infinite where a component was not reported.
        sigma_enu: [f64; 3],
    },
    /// Velocity of the DVL transducer in instrument axes, m/s.
    Dvl {
        /// Velocity over ground, m/s.
        velocity_dvl: [f64; 3],
    },
    /// Heading of the body x axis.
    Mcp {
        /// Clockwise from true north at the vehicle, rad, declination added.
        heading: f64,
    },
    /// Depth of the pressure port.
    Ps {
        /// Positive down from the mean surface, m.
        depth: f64,
    },
    /// A keyframe at `t_keyframe`; closes the interval since the last one.
    Keyframe {
        /// Why the keyframe was made.
        cause: KeyframeCause,
    },
}

/// Why a keyframe was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum KeyframeCause {
    /// The first of a run.
    Start = 0,
    /// An LBL epoch.
    Lbl = 1,
    /// The last keyframe grew too old.
    Age = 2,
    /// An IMU gap too long for the preintegration to be trusted.
    ImuGap = 3,
}

/// A message that is not a measurement.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MeasurementError {
    /// No such kind.
    #[error("measurement of unknown kind {0}")]
    UnknownKind(u32),
    /// A value is not a number, or infinite where it may not be.
    #[error("{sensor} measurement with a value that is not finite")]
    NotFinite {
        /// Whose.
        sensor: Sensor,
    },
    /// A value outside its domain.
    #[error("{0}")]
    Impossible(&'static str),
}

impl Measurement {
    /// `kind` of a keyframe.
    pub const KEYFRAME: u32 = 100;

    /// Packs a checked reading.
    pub fn new(t_valid: Time, t_keyframe: Time, reading: &Reading) -> Measurement {
        let mut values = [0.0; 12];
        let mut epoch_of = 0;
        let kind = match *reading {
            Reading::Imu { gyro_body, accel_body } => {
                values[..3].copy_from_slice(&gyro_body);
                values[3..6].copy_from_slice(&accel_body);
                Sensor::Imu as u32
            }
            Reading::Lbl { buoy, epoch, range, buoy_enu, buoy_sigma, is_moored } => {
                values[0] = range;
                values[1..4].copy_from_slice(&buoy_enu);
                values[4] = buoy_sigma;
                values[5] = f64::from(buoy);
                values[6] = f64::from(u8::from(is_moored));
                epoch_of = epoch;
                Sensor::Lbl as u32
            }
            Reading::Gnss { antenna_enu, sigma_enu } => {
                values[..3].copy_from_slice(&antenna_enu);
                values[3..6].copy_from_slice(&sigma_enu);
                Sensor::Gnss as u32
            }
            Reading::Dvl { velocity_dvl } => {
                values[..3].copy_from_slice(&velocity_dvl);
                Sensor::Dvl as u32
            }
            Reading::Mcp { heading } => {
                values[0] = heading;
                Sensor::Mcp as u32
            }
            Reading::Ps { depth } => {
                values[0] = depth;
                Sensor::Ps as u32
            }
            Reading::Keyframe { cause } => {
                values[0] = f64::from(cause as u32);
                Measurement::KEYFRAME
            }
        };
        Measurement { header: Header::at(t_valid), t_keyframe: t_keyframe.0, kind, epoch: epoch_of, values }
    }

    /// The sensor, if the kind names one.
    pub fn sensor(&self) -> Option<Sensor> {
        Sensor::from_index(self.kind)
    }

    /// Data time at which the reading was valid.
    pub fn t_valid(&self) -> Time {
        Time(self.header.t_valid)
    }

    /// Keyframe that it is tied to.
    pub fn t_keyframe(&self) -> Time {
        Time(self.t_keyframe)
    }
}

impl TryFrom<&Measurement> for Reading {
    type Error = MeasurementError;

    fn try_from(measurement: &Measurement) -> Result<Reading, MeasurementError> {
        let v = &measurement.values;
        let triple = |at: usize| [v[at], v[at + 1], v[at + 2]];
        let finite = |count: usize, sensor: Sensor| {
            if v[..count].iter().all(|x| x.is_finite()) { Ok(()) } else { Err(MeasurementError::NotFinite { sensor }) }
        };
        match measurement.kind {
            Measurement::KEYFRAME => {
                let cause = match v[0] {
                    0.0 => KeyframeCause::Start,
                    1.0 => KeyframeCause::Lbl,
                    2.0 => KeyframeCause::Age,
                    3.0 => KeyframeCause::ImuGap,
                    _ => return Err(MeasurementError::Impossible("keyframe of unknown cause")),
                };
                Ok(Reading::Keyframe { cause })
            }
            kind => match Sensor::from_index(kind) {
                Some(Sensor::Imu) => {
                    finite(6, Sensor::Imu)?;
                    Ok(Reading::Imu { gyro_body: triple(0), accel_body: triple(3) })
                }
                Some(Sensor::Lbl) => {
                    finite(7, Sensor::Lbl)?;
                    if v[0] <= 0.0 || v[4] < 0.0 || v[5] < 0.0 || v[5] > f64::from(u32::MAX) || v[5].fract() != 0.0 {
                        return Err(MeasurementError::Impossible("range, buoy sigma or buoy number out of its domain"));
                    }
                    Ok(Reading::Lbl {
                        buoy: v[5] as u32,
                        epoch: measurement.epoch,
                        range: v[0],
                        buoy_enu: triple(1),
                        buoy_sigma: v[4],
                        is_moored: v[6] != 0.0,
                    })
                }
                Some(Sensor::Gnss) => {
                    finite(3, Sensor::Gnss)?;
                    let sigma_enu = triple(3);
                    if sigma_enu.iter().any(|&s| s.is_nan() || s <= 0.0) {
                        return Err(MeasurementError::Impossible("gnss sigma must be positive"));
                    }
                    Ok(Reading::Gnss { antenna_enu: triple(0), sigma_enu })
                }
                Some(Sensor::Dvl) => {
                    finite(3, Sensor::Dvl)?;
                    Ok(Reading::Dvl { velocity_dvl: triple(0) })
                }
                Some(Sensor::Mcp) => {
                    finite(1, Sensor::Mcp)?;
                    Ok(Reading::Mcp { heading: v[0] })
                }
                Some(Sensor::Ps) => {
                    finite(1, Sensor::Ps)?;
                    Ok(Reading::Ps { depth: v[0] })
                }
                Some(Sensor::Buoys) | None => Err(MeasurementError::UnknownKind(kind)),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reading_survives_the_wire() {
        let readings = [
            Reading::Imu { gyro_body: [0.1, 0.2, 0.3], accel_body: [0.0, -1.0, 9.8] },
            Reading::Lbl {
                buoy: 7,
                epoch: 41,
                range: 612.5,
                buoy_enu: [1.0, 2.0, -3.0],
                buoy_sigma: 0.5,
                is_moored: true,
            },
            Reading::Gnss { antenna_enu: [1.0, 2.0, 3.0], sigma_enu: [0.5, 0.5, f64::INFINITY] },
            Reading::Dvl { velocity_dvl: [1.5, 0.0, -0.1] },
            Reading::Mcp { heading: 1.25 },
            Reading::Ps { depth: 50.0 },
            Reading::Keyframe { cause: KeyframeCause::Age },
        ];
        for reading in readings {
            let wire = Measurement::new(Time(12), Time(10), &reading);
            assert_eq!(Reading::try_from(&wire), Ok(reading));
            assert_eq!((wire.t_valid(), wire.t_keyframe()), (Time(12), Time(10)));
        }
    }

    #[test]
    fn what_is_not_a_measurement_is_named() {
        let mut wire = Measurement::new(Time(0), Time(0), &Reading::Ps { depth: f64::NAN });
        assert_eq!(Reading::try_from(&wire), Err(MeasurementError::NotFinite { sensor: Sensor::Ps }));
        wire.kind = 55;
        assert_eq!(Reading::try_from(&wire), Err(MeasurementError::UnknownKind(55)));
    }
}
