//! The world that is not there: trajectories, a strapdown IMU, sensors with errors.
//!
//! A [`World`] is a pure function of a [`Scenario`], a [`Preset`] of sensor errors and a seed. It is an independent second
//! opinion on the estimator: it shares geometry (ellipsoid, gravity) with it and nothing else, for shared code would hide
//! a shared sign error.
//!
//! ```
//! use sim_world::{Preset, Scenario, World};
//!
//! let scenario = Scenario::builtin("stable")?;
//! let world = World::new(&scenario, Preset::Realistic, 1)?;
//! let first = world.imu().next().expect("the scenario has an IMU");
//! assert!((first.accel_body[2] - 9.8).abs() < 0.1);
//! # Ok::<(), sim_world::ScenarioError>(())
//! ```

mod buoys;
mod dvl;
mod gnss;
mod imu;
mod jet;
mod lbl;
mod mcp;
mod merge;
mod noise;
mod plan;
mod profile;
mod ps;
mod readings;
mod scenario;
mod scenario_file;
mod sensors_toml;
mod strapdown;
mod trajectory;
mod world;

pub use noise::{Preset, SensorNoise};
pub use scenario::{
    BUILTIN_SCENARIOS, Buoy, BuoySetup, Drift, DvlSetup, GnssSetup, ImuSetup, InitialSetup, LblSetup, Manoeuvre,
    McpSetup, PsSetup, Scenario, ScenarioError, Schedule, Segment, VehicleSetup, WaveSetup,
};
pub use trajectory::Motion;
pub use world::World;
