//! Where things are: rotations, WGS-84, the local frame, gravity.
//!
//! Everything here is a pure function of its arguments, in SI units and radians. Frames: `ecef` (Earth-centred,
//! Earth-fixed), `geodetic` (latitude, longitude, ellipsoidal height) and `enu`, the tangent plane of WGS-84 at a fixed
//! origin ([`LocalFrame`]).

pub mod gravity;
pub mod local_frame;
pub mod so3;
pub mod testing;
pub mod utm;
pub mod wgs84;

pub use gravity::{GravityModel, normal_gravity};
pub use local_frame::{LocalFrame, SurfacePoint};
pub use utm::UtmZone;
pub use wgs84::Geodetic;
