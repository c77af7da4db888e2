//! Facts of the vehicle: `sensors.toml` as it lies in a log directory, and the checked SI values made from it.
//!
//! Two layers: the file's shape ([`Sections`], degrees as written) and what the rest of the code sees ([`Vehicle`],
//! radians, checked). Every key is optional; the defaults are those of the format document.

use serde::{Deserialize, Serialize};

use crate::config::{Problem, non_negative, positive};
use crate::time::Time;

/// Checked facts of the vehicle, SI units.
#[derive(Clone, Debug, PartialEq)]
pub struct Vehicle {
    /// Navigation frame.
    pub frame: Frame,
    /// Start of the estimation; absent fields are found from the data.
    pub initial: Initial,
    /// IMU noise.
    pub imu: ImuNoise,
    /// Acoustic ranging.
    pub lbl: Lbl,
    /// Satellite receiver.
    pub gnss: Gnss,
    /// Doppler log.
    pub dvl: Dvl,
    /// Compass.
    pub mcp: Mcp,
    /// Pressure sensor.
    pub ps: Ps,
}

/// Navigation frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Latitude (rad), longitude (rad), ellipsoidal height (m) of the ENU origin; `None`: the first fix.
    pub origin_geodetic: Option<[f64; 3]>,
    /// Ellipsoidal height of the mean water surface, m.
    pub surface_height: f64,
}

/// Start of the estimation.
#[derive(Clone, Debug, PartialEq)]
pub struct Initial {
    /// When it starts; `None`: at the first IMU sample.
    pub t: Option<Time>,
    /// m.
    pub position_enu: Option<[f64; 3]>,
    /// m/s.
    pub velocity_enu: Option<[f64; 3]>,
    /// Body to ENU, unit, Hamilton (w, x, y, z).
    pub q_enu_body: Option<[f64; 4]>,
    /// 1-sigma per axis, m.
    pub sigma_position: f64,
    /// 1-sigma per axis, m/s.
    pub sigma_velocity: f64,
    /// 1-sigma about body x, body y and the up axis, rad.
    pub sigma_attitude: [f64; 3],
}

impl Initial {
    /// The state is that of another time: the first one is to be told from the data.
    pub fn forget_state(&mut self) {
        (self.position_enu, self.velocity_enu, self.q_enu_body) = (None, None, None);
    }
}

/// No accelerometer is believed to be better than 1 µg/√Hz, m/s²/√Hz; none is. One of a tenth of it, as in the paper's Table I, claims
/// nanometres of each interval, and beside the reciprocals of their squares those of a height that hardly anything sees are lost to
/// rounding: with range differences and no depth the estimate then left for good.
const ACCEL_NOISE_LEAST: f64 = 1e-5;

/// IMU noise, continuous time.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuNoise {
    /// rad/s/√Hz.
    pub gyro_noise_density: f64,
    /// m/s²/√Hz, of a configuration no less than 1e-5.
    pub accel_noise_density: f64,
    /// rad/s²/√Hz.
    pub gyro_bias_random_walk: f64,
    /// m/s³/√Hz.
    pub accel_bias_random_walk: f64,
    /// 1-sigma of the turn-on bias, rad/s.
    pub gyro_bias_sigma: f64,
    /// 1-sigma of the turn-on bias, m/s².
    pub accel_bias_sigma: f64,
}

/// Acoustic ranging.
#[derive(Clone, Debug, PartialEq)]
pub struct Lbl {
    /// 1-sigma of a range, m.
    pub sigma: f64,
    /// From the IMU to the transducer, m.
    pub lever_arm_body: [f64; 3],
    /// Buoy of the filters' plain differences.
    pub reference_buoy: u32,
    /// 1-sigma per axis of a buoy's position, m. Of a moored one it is the survey's error, the same in all its ranges; of a drifting
    /// one each fix has its own.
    pub buoy_sigma: f64,
}

/// Satellite receiver.
#[derive(Clone, Debug, PartialEq)]
pub struct Gnss {
    /// 1-sigma east, north, up where a fix gives none, m.
    pub sigma_enu: [f64; 3],
    /// From the IMU to the antenna, m.
    pub lever_arm_body: [f64; 3],
}

/// Doppler log.
#[derive(Clone, Debug, PartialEq)]
pub struct Dvl {
    /// 1-sigma per axis, m/s.
    pub sigma: f64,
    /// From the IMU to the transducer, m.
    pub lever_arm_body: [f64; 3],
    /// Roll, pitch, yaw of the instrument in the body frame, rad: R_body_dvl = Rz(yaw) Ry(pitch) Rx(roll).
    pub mounting_rpy: [f64; 3],
}

/// Compass.
#[derive(Clone, Debug, PartialEq)]
pub struct Mcp {
    /// 1-sigma, rad.
    pub sigma: f64,
    /// Added to the reported heading, rad.
    pub declination: f64,
}

/// Pressure sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Ps {
    /// 1-sigma, m.
    pub sigma: f64,
    /// From the IMU to the port, m.
    pub lever_arm_body: [f64; 3],
}

/// The file's shape.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Sections {
    frame: FrameSection,
    initial: InitialSection,
    imu: ImuSection,
    lbl: LblSection,
    gnss: GnssSection,
    dvl: DvlSection,
    mcp: McpSection,
    ps: PsSection,
}

impl Sections {
    /// What is given beyond what is believed becomes that. What is no noise at all stays, to be refused.
    pub(crate) fn settle(&mut self) {
        let given = &mut self.imu.accel_noise_density;
        if *given > 0.0 {
            *given = given.max(ACCEL_NOISE_LEAST);
        }
    }
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct FrameSection {
    #[serde(skip_serializing_if = "Option::is_none")]
    origin: Option<[f64; 3]>,
    surface_height: f64,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct InitialSection {
    #[serde(skip_serializing_if = "Option::is_none")]
    t: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    position: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    velocity: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    quaternion: Option<[f64; 4]>,
    sigma_position: f64,
    sigma_velocity: f64,
    sigma_attitude: [f64; 3],
}

impl Default for InitialSection {
    fn default() -> Self {
        InitialSection {
            t: None,
            position: None,
            velocity: None,
            quaternion: None,
            sigma_position: 1.0,
            sigma_velocity: 0.1,
            sigma_attitude: [0.5, 0.5, 2.0],
        }
    }
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct ImuSection {
    gyro_noise_density: f64,
    accel_noise_density: f64,
    gyro_bias_random_walk: f64,
    accel_bias_random_walk: f64,
    gyro_bias_sigma: f64,
    accel_bias_sigma: f64,
}

impl Default for ImuSection {
    fn default() -> Self {
        ImuSection {
            gyro_noise_density: 2.9e-5,
            accel_noise_density: 1.0e-3,
            gyro_bias_random_walk: 1.0e-7,
            accel_bias_random_walk: 1.0e-6,
            gyro_bias_sigma: 1.2e-4,
            accel_bias_sigma: 1.0e-3,
        }
    }
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct LblSection {
    sigma: f64,
    lever_arm: [f64; 3],
    reference_buoy: u32,
    buoy_sigma: f64,
}

impl Default for LblSection {
    fn default() -> Self {
        LblSection { sigma: 0.3, lever_arm: [0.0; 3], reference_buoy: 1, buoy_sigma: 0.0 }
    }
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct GnssSection {
    sigma: [f64; 3],
    lever_arm: [f64; 3],
}

impl Default for GnssSection {
    fn default() -> Self {
        GnssSection { sigma: [2.0, 2.0, 4.0], lever_arm: [0.0; 3] }
    }
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct DvlSection {
    sigma: f64,
    lever_arm: [f64; 3],
    mounting_rpy: [f64; 3],
}

impl Default for DvlSection {
    fn default() -> Self {
        DvlSection { sigma: 0.01, lever_arm: [0.0; 3], mounting_rpy: [0.0; 3] }
    }
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct McpSection {
    sigma: f64,
    declination: f64,
}

impl Default for McpSection {
    fn default() -> Self {
        McpSection { sigma: 0.01, declination: 0.0 }
    }
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct PsSection {
    sigma: f64,
    lever_arm: [f64; 3],
}

impl Default for PsSection {
    fn default() -> Self {
        PsSection { sigma: 0.01, lever_arm: [0.0; 3] }
    }
}

/// Keys without a default, which a serialised default therefore does not show.
pub(crate) const OPTIONAL_KEYS: [(&str, &str); 5] = [
    ("frame", "origin"),
    ("initial", "t"),
    ("initial", "position"),
    ("initial", "velocity"),
    ("initial", "quaternion"),
];

fn finite<const N: usize>(key: &'static str, values: [f64; N]) -> Result<[f64; N], Problem> {
    if values.iter().all(|v| v.is_finite()) {
        Ok(values)
    } else {
        Err(Problem::new(key, format!("{values:?}"), "every number must be finite"))
    }
}

impl TryFrom<&Sections> for Vehicle {
    type Error = Problem;

    fn try_from(file: &Sections) -> Result<Vehicle, Problem> {
        let degrees = |values: [f64; 3]| values.map(f64::to_radians);
        Ok(Vehicle {
            frame: Frame::try_from(&file.frame)?,
            initial: Initial::try_from(&file.initial)?,
            imu: ImuNoise {
                gyro_noise_density: positive("imu.gyro_noise_density", file.imu.gyro_noise_density)?,
                accel_noise_density: positive("imu.accel_noise_density", file.imu.accel_noise_density)?,
                gyro_bias_random_walk: positive("imu.gyro_bias_random_walk", file.imu.gyro_bias_random_walk)?,
                accel_bias_random_walk: positive("imu.accel_bias_random_walk", file.imu.accel_bias_random_walk)?,
                gyro_bias_sigma: positive("imu.gyro_bias_sigma", file.imu.gyro_bias_sigma)?,
                accel_bias_sigma: positive("imu.accel_bias_sigma", file.imu.accel_bias_sigma)?,
            },
            lbl: Lbl {
                sigma: positive("lbl.sigma", file.lbl.sigma)?,
                lever_arm_body: finite("lbl.lever_arm", file.lbl.lever_arm)?,
                reference_buoy: file.lbl.reference_buoy,
                buoy_sigma: non_negative("lbl.buoy_sigma", file.lbl.buoy_sigma)?,
            },
            gnss: Gnss {
                sigma_enu: {
                    for value in file.gnss.sigma {
                        positive("gnss.sigma", value)?;
                    }
                    file.gnss.sigma
                },
                lever_arm_body: finite("gnss.lever_arm", file.gnss.lever_arm)?,
            },
            dvl: Dvl {
                sigma: positive("dvl.sigma", file.dvl.sigma)?,
                lever_arm_body: finite("dvl.lever_arm", file.dvl.lever_arm)?,
                mounting_rpy: degrees(finite("dvl.mounting_rpy", file.dvl.mounting_rpy)?),
            },
            mcp: Mcp {
                sigma: positive("mcp.sigma", file.mcp.sigma)?.to_radians(),
                declination: finite("mcp.declination", [file.mcp.declination])?[0].to_radians(),
            },
            ps: Ps {
                sigma: positive("ps.sigma", file.ps.sigma)?,
                lever_arm_body: finite("ps.lever_arm", file.ps.lever_arm)?,
            },
        })
    }
}

impl TryFrom<&FrameSection> for Frame {
    type Error = Problem;

    fn try_from(file: &FrameSection) -> Result<Frame, Problem> {
        let origin_geodetic = match file.origin {
            None => None,
            Some(origin) => {
                let [lat_deg, lon_deg, height] = finite("frame.origin", origin)?;
                if lat_deg.abs() > 90.0 || lon_deg.abs() > 360.0 {
                    return Err(Problem::new(
                        "frame.origin",
                        format!("{origin:?}"),
                        "latitude within 90 deg and longitude within 360 deg, in this order",
                    ));
                }
                Some([lat_deg.to_radians(), lon_deg.to_radians(), height])
            }
        };
        Ok(Frame { origin_geodetic, surface_height: finite("frame.surface_height", [file.surface_height])?[0] })
    }
}

impl TryFrom<&InitialSection> for Initial {
    type Error = Problem;

    fn try_from(file: &InitialSection) -> Result<Initial, Problem> {
        // Files print quaternions with seven digits or so; anything further from one is a mistake, not rounding.
        const NORM_TOLERANCE: f64 = 1e-3;
        let q_enu_body = match file.quaternion {
            None => None,
            Some(q) => {
                finite("initial.quaternion", q)?;
                let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
                if (norm - 1.0).abs() > NORM_TOLERANCE {
                    return Err(Problem::new(
                        "initial.quaternion",
                        format!("{q:?}, of norm {norm:.4}"),
                        "a unit quaternion, qw first",
                    ));
                }
                Some(q.map(|x| x / norm))
            }
        };
        for value in file.sigma_attitude {
            positive("initial.sigma_attitude", value)?;
        }
        let t = match file.t {
            None => None,
            // 9.2e9 s are the nanoseconds that 64 bits hold.
            Some(t) if t.is_finite() && t.abs() < 9.2e9 => Some(Time::from_seconds(t)),
            Some(t) => return Err(Problem::new("initial.t", format!("{t}"), "seconds on the clock of the log")),
        };
        Ok(Initial {
            t,
            position_enu: file.position.map(|p| finite("initial.position", p)).transpose()?,
            velocity_enu: file.velocity.map(|v| finite("initial.velocity", v)).transpose()?,
            q_enu_body,
            sigma_position: positive("initial.sigma_position", file.sigma_position)?,
            sigma_velocity: positive("initial.sigma_velocity", file.sigma_velocity)?,
            sigma_attitude: file.sigma_attitude.map(f64::to_radians),
        })
    }
}

impl Default for Vehicle {
    fn default() -> Self {
        Vehicle::try_from(&Sections::default()).expect("the documented defaults are valid")
    }
}
