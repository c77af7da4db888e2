//! What each sensor sees of the state at its own time: residual, Jacobian and covariance, one file a sensor.

pub mod dvl;
pub mod gnss;
pub mod lbl;
pub mod mcp;
pub mod model;
pub mod ps;

#[cfg(test)]
mod tests;

pub use dvl::DvlModel;
pub use gnss::GnssModel;
pub use lbl::LblModel;
pub use mcp::McpModel;
pub use model::{GyroAt, Model};
pub use ps::PsModel;
