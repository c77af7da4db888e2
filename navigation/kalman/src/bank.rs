//! Who runs the filters' equations. [`Centralised`]: one filter takes in every sensor.

use nav_models::imu_history::{ImuHistory, ImuModel};
use nav_models::kernels::Block;
use nav_models::recovery::Loosening;
use nav_models::state::{ERROR_DIM, NavState};
use nav_models::world::WorldModel;
use shared_types::{Config, Time};

use crate::filter::{Diverged, Filter};

/// A stretch of time and what the IMU said in it.
#[derive(Clone, Copy, Debug)]
pub struct Stretch<'a> {
    /// Where the filters stand.
    pub from: Time,
    /// Where they go.
    pub to: Time,
    /// Samples that reach from one to the other.
    pub history: &'a ImuHistory,
    /// The instrument.
    pub imu: &'a ImuModel,
    /// What the vehicle moves in.
    pub world: &'a WorldModel,
}

/// One filter or several that share the sensors between them.
pub trait Bank: Clone {
    /// Begins with a state and its covariance.
    fn start(config: &Config, state: &NavState, covariance: &Block<ERROR_DIM>) -> Self;

    /// Carries everybody over a stretch.
    ///
    /// # Errors
    /// [`Diverged`]: the samples do not reach, or a number is none; everybody stands as before.
    fn predict(&mut self, stretch: &Stretch<'_>) -> Result<(), Diverged>;

    /// The filter that takes in the sensor at this place in [`shared_types::AIDING`].
    fn local(&mut self, place: usize) -> &mut Filter;

    /// A group of measurements has been folded into a local filter.
    ///
    /// # Errors
    /// [`Diverged`]: what was folded in is lost.
    fn fuse(&mut self) -> Result<(), Diverged>;

    /// Admits that everybody is further off than their covariances say.
    fn loosen(&mut self, by: &Loosening);

    /// What they say together.
    fn published(&self) -> Filter;
}

/// One filter with all sensors: EKF-ILNS.
#[derive(Clone, Copy, Debug)]
pub struct Centralised(Filter);

impl Bank for Centralised {
    fn start(_config: &Config, state: &NavState, covariance: &Block<ERROR_DIM>) -> Centralised {
        Centralised(Filter::new(*state, *covariance))
    }

    fn predict(&mut self, stretch: &Stretch<'_>) -> Result<(), Diverged> {
        let NavState { accel_bias, gyro_bias, .. } = self.0.state;
        let Stretch { from, to, history, imu, world } = *stretch;
        let increment = history.integrate(from, to, &accel_bias, &gyro_bias, imu).ok_or(Diverged)?;
        self.0.predict(&increment, 1.0, world)
    }

    fn local(&mut self, _place: usize) -> &mut Filter {
        &mut self.0
    }

    fn fuse(&mut self) -> Result<(), Diverged> {
        Ok(())
    }

    fn loosen(&mut self, by: &Loosening) {
        self.0.loosen(by);
    }

    fn published(&self) -> Filter {
        self.0
    }
}
