//! What the world does and what a sensor sees: state, preintegration, transport, sensor models, propagator.
//!
//! Frames are named in every field: `enu` (local East-North-Up of the run's origin) and `body` (forward, left, up, at the
//! IMU). Time differences are signed seconds; a negative one goes backward. Residuals are predicted minus measured.

pub mod anchor;
pub mod anchored;
mod blocks;
pub mod doubt;
pub mod estimator;
pub mod gaps;
pub mod imu_history;
pub mod inertial;
pub mod initialisation;
pub mod innovation;
pub mod judging;
pub mod kernels;
mod persistence;
pub mod prediction;
pub mod preintegration;
pub mod propagator;
mod pull;
pub mod recovery;
pub mod robust;
pub mod rounds;
pub mod row;
pub mod sensors;
pub mod state;
#[cfg(test)]
mod testing;
pub mod transport;
pub mod world;

pub use anchored::{Anchored, Pose, Seen, SensorModel};
#[doc(hidden)]
pub use blocks::dispatch;
pub use estimator::{Effort, Estimator, EstimatorError};
pub use inertial::{ImuFactor, ImuJacobians, ImuWeight, NotPositiveDefinite};
pub use initialisation::Initialiser;
pub use preintegration::{CorrectedIncrement, ImuPoint, Increment, NoiseRows, Piece, Preintegration, Turned};
pub use propagator::{Propagator, PropagatorError};
pub use state::{ACCEL_BIAS, ATTITUDE, ERROR_DIM, GYRO_BIAS, NavState, POSITION, VELOCITY};
pub use transport::{TransportJacobians, transport, transport_jacobians};
pub use world::WorldModel;
