//! Pressure sensor (PS): depth of the pressure port below the mean surface (§3.6 of the method).
//!
//! ```text
//! residual = h_s − height(p + R l) − depth                                        [m], 1 row
//! H = [−n̂ᵀ | 0 | n̂ᵀR[l]×],   n̂ = ellipsoid normal at the port
//! ```
//!
//! Height above the ellipsoid, through ECEF: 5 km from the origin it differs from the `up` coordinate by 2 m. The sign is
//! made explicit: depth grows downwards (the paper's term, read as a depth, has it turned). Lever arm added.

use nalgebra::{SMatrix, Vector1, Vector3};
use nav_geometry::SurfacePoint;
use shared_types::Vehicle;

use crate::anchored::{Pose, Seen, SensorModel};
use crate::blocks::{times, transposed_times};
use crate::state::{ATTITUDE, POSITION};
use crate::world::WorldModel;

/// One depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PsModel {
    /// Measured, positive down from the mean surface, m.
    pub depth: f64,
    /// From the IMU to the pressure port, m.
    pub lever_arm_body: Vector3<f64>,
    /// Ellipsoidal height of the mean surface, m.
    pub surface_height: f64,
    /// 1-sigma, m.
    pub sigma: f64,
}

impl PsModel {
    /// A depth with the vehicle's surface height, lever arm and sigma.
    pub fn new(depth: f64, vehicle: &Vehicle) -> PsModel {
        PsModel {
            depth,
            lever_arm_body: Vector3::from(vehicle.ps.lever_arm_body),
            surface_height: vehicle.frame.surface_height,
            sigma: vehicle.ps.sigma,
        }
    }
}

impl SensorModel<1> for PsModel {
    fn see(&self, pose: &Pose, world: &WorldModel) -> Seen<1> {
        let port_enu = pose.position_enu + times(&pose.r_enu_body, &self.lever_arm_body);
        let SurfacePoint { up_enu, height, .. } = world.frame.surface_point(&port_enu);
        let down = -up_enu;
        let mut jacobian = SMatrix::<f64, 1, 9>::zeros();
        jacobian.fixed_columns_mut::<3>(POSITION).copy_from(&down.transpose());
        let by_attitude = self.lever_arm_body.cross(&transposed_times(&pose.r_enu_body, &down));
        jacobian.fixed_columns_mut::<3>(ATTITUDE).copy_from(&by_attitude.transpose());
        Seen {
            residual: Vector1::new(self.surface_height - height - self.depth),
            jacobian,
            covariance: SMatrix::<f64, 1, 1>::new(self.sigma * self.sigma),
        }
    }
}
