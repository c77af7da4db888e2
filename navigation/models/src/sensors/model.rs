//! Any reading as the model of its sensor.

use nalgebra::Vector3;
use shared_types::{Reading, RejectReason, Sensor, Vehicle};

use super::{DvlModel, GnssModel, LblModel, McpModel, PsModel};
use crate::anchored::{Anchored, Pose, SensorModel};
use crate::row::{MeasuredRows, Unusable, inverse_root};
use crate::state::NavState;
use crate::world::WorldModel;

/// What was measured.
#[derive(Clone, Copy, Debug)]
pub enum Model {
    /// One slant range.
    Lbl(LblModel),
    /// Antenna position.
    Gnss(GnssModel),
    /// Velocity of the DVL.
    Dvl(DvlModel),
    /// Heading.
    Mcp(McpModel),
    /// Depth.
    Ps(PsModel),
}

/// What the gyroscope says at a reading.
#[derive(Clone, Copy, Debug)]
pub struct GyroAt {
    /// Raw rate at the time of the reading, rad/s.
    pub gyro_body: Vector3<f64>,
    /// Sampling period of the IMU there, s.
    pub dt_imu: f64,
}

impl Model {
    /// Of a reading, with the facts of the vehicle; `state` is the estimate near it, `gyro` is asked only by sensors that
    /// look at the gyroscope.
    ///
    /// # Errors
    /// Why it cannot be used: no IMU data around it, a heading near the vertical, or no aiding sensor's reading.
    #[inline]
    pub fn of(
        reading: &Reading,
        vehicle: &Vehicle,
        state: &NavState,
        world: &WorldModel,
        gyro: impl FnOnce() -> Option<GyroAt>,
    ) -> Result<Model, RejectReason> {
        match *reading {
            Reading::Lbl { range, buoy_enu, buoy_sigma, .. } => {
                Ok(Model::Lbl(LblModel::new(range, buoy_enu, buoy_sigma, &vehicle.lbl)))
            }
            Reading::Gnss { antenna_enu, sigma_enu } => {
                Ok(Model::Gnss(GnssModel::new(antenna_enu, sigma_enu, &vehicle.gnss, world)))
            }
            Reading::Dvl { velocity_dvl } => {
                let GyroAt { gyro_body, dt_imu } = gyro().ok_or(RejectReason::NoImu)?;
                Ok(Model::Dvl(DvlModel::new(velocity_dvl, gyro_body, &vehicle.dvl, &vehicle.imu, dt_imu)))
            }
            Reading::Mcp { .. } if !McpModel::is_usable(state, world) => Err(RejectReason::NearVertical),
            Reading::Mcp { heading } => Ok(Model::Mcp(McpModel::new(heading, &vehicle.mcp))),
            Reading::Ps { depth } => Ok(Model::Ps(PsModel::new(depth, vehicle))),
            Reading::Imu { .. } | Reading::Keyframe { .. } => Err(RejectReason::Malformed),
        }
    }

    /// Whose measurement.
    #[inline]
    pub fn sensor(&self) -> Sensor {
        match self {
            Model::Lbl(_) => Sensor::Lbl,
            Model::Gnss(_) => Sensor::Gnss,
            Model::Dvl(_) => Sensor::Dvl,
            Model::Mcp(_) => Sensor::Mcp,
            Model::Ps(_) => Sensor::Ps,
        }
    }

    /// Place of that sensor in [`shared_types::AIDING`].
    #[inline]
    pub fn place(&self) -> usize {
        match self {
            Model::Lbl(_) => 0,
            Model::Gnss(_) => 1,
            Model::Dvl(_) => 2,
            Model::Mcp(_) => 3,
            Model::Ps(_) => 4,
        }
    }

    /// Degrees of freedom of a test on it.
    #[inline]
    pub fn components(&self) -> usize {
        match self {
            Model::Gnss(model) => model.components(),
            Model::Dvl(_) => 3,
            Model::Lbl(_) | Model::Mcp(_) | Model::Ps(_) => 1,
        }
    }

    /// Takes a further systematic error of `by`, in the unit of the sensor's calibration, out of the reading.
    pub fn correct(&mut self, by: f64) {
        match self {
            Model::Lbl(model) => model.range_scale += by,
            Model::Dvl(model) => model.scale += by,
            Model::Gnss(_) | Model::Mcp(_) | Model::Ps(_) => {}
        }
    }

    /// Its rows at the state of its own time, whitened by its own noise.
    ///
    /// # Errors
    /// [`Unusable`]: the covariance is singular or a number is not finite.
    pub fn rows_at(&self, state: &NavState, world: &WorldModel) -> Result<MeasuredRows, Unusable> {
        match self {
            Model::Lbl(model) => rows_of(model, state, world),
            Model::Gnss(model) => rows_of(model, state, world),
            Model::Dvl(model) => rows_of(model, state, world),
            Model::Mcp(model) => rows_of(model, state, world),
            Model::Ps(model) => rows_of(model, state, world),
        }
    }
}

fn rows_of<const ROWS: usize>(
    model: &impl SensorModel<ROWS>,
    state: &NavState,
    world: &WorldModel,
) -> Result<MeasuredRows, Unusable> {
    let anchored = Anchored::at_keyframe(model, &Pose::from(state), world);
    let whitening = inverse_root(&anchored.covariance).ok_or(Unusable)?;
    MeasuredRows::whitened(&anchored, &whitening, &nalgebra::SMatrix::zeros())
}
