//! Doppler velocity log (DVL): velocity of the transducer over ground in the instrument's axes (§3.5 of the method).
//!
//! ```text
//! u = Rᵀv,   ω_nb = ω̃(t) − b_g − Rᵀω,   residual = Mᵀ(u + ω_nb × l) − velocity_dvl      [m/s], 3 rows
//! H = Mᵀ[0 | Rᵀ | [u]× + [l]×[Rᵀω]×],   ∂h/∂b_g = Mᵀ[l]×
//! ```
//!
//! M takes the instrument's axes to the body; with a scale that is off by s, h is (1 + s) times that. The paper compares
//! velocities in the world frame, where a DVL has none: it measures in the body, and so it tells of attitude. The gyroscope sample that moves the lever arm is noisy too:
//! R_z gains `Mᵀ[l]×(σ_g²/Δt)[l]×ᵀM`.

use nalgebra::{Matrix3, Rotation3, SMatrix, Vector3};
use nav_geometry::so3;
use shared_types::{Dvl, ImuNoise};

use crate::anchored::{Pose, Seen, SensorModel};
use crate::blocks::{product, product_transposed, product_with_skew, times, transposed_times};
use crate::state::{ATTITUDE, VELOCITY};
use crate::world::WorldModel;

/// One velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DvlModel {
    /// Measured, instrument axes, m/s.
    pub velocity_dvl: Vector3<f64>,
    /// Angular rate at the time of the reading as the IMU says it, bias included, rad/s.
    pub gyro_body: Vector3<f64>,
    /// From the IMU to the transducer, m.
    pub lever_arm_body: Vector3<f64>,
    /// Relative error of the velocity scale; 0 unless it is estimated.
    pub scale: f64,
    /// Mᵀ.
    r_dvl_body: Matrix3<f64>,
    covariance: Matrix3<f64>,
}

impl DvlModel {
    /// A velocity with the vehicle's mounting, lever arm and sigma. `gyro_body`: raw rate at the time of the reading;
    /// `dt_imu`: sampling period of the IMU, s, over which that rate is an average.
    pub fn new(velocity_dvl: [f64; 3], gyro_body: Vector3<f64>, dvl: &Dvl, imu: &ImuNoise, dt_imu: f64) -> DvlModel {
        let [roll, pitch, yaw] = dvl.mounting_rpy;
        let r_dvl_body = Rotation3::from_euler_angles(roll, pitch, yaw).into_inner().transpose();
        let lever_arm_body = Vector3::from(dvl.lever_arm_body);
        let gyro_variance = imu.gyro_noise_density * imu.gyro_noise_density / dt_imu;
        let by_gyro = r_dvl_body * so3::skew(&lever_arm_body);
        DvlModel {
            velocity_dvl: Vector3::from(velocity_dvl),
            gyro_body,
            lever_arm_body,
            scale: 0.0,
            r_dvl_body,
            covariance: Matrix3::identity() * (dvl.sigma * dvl.sigma) + by_gyro * by_gyro.transpose() * gyro_variance,
        }
    }

    /// Without the noise of the gyroscope sample, for comparison with references that leave it out.
    #[must_use]
    pub fn with_covariance(mut self, covariance: Matrix3<f64>) -> DvlModel {
        self.covariance = covariance;
        self
    }
}

impl SensorModel<3> for DvlModel {
    fn see(&self, pose: &Pose, world: &WorldModel) -> Seen<3> {
        let velocity_body = transposed_times(&pose.r_enu_body, &pose.velocity_enu);
        let earth_rate_body = transposed_times(&pose.r_enu_body, &world.earth_rate_enu);
        let arm = &self.lever_arm_body;
        let rate_body = self.gyro_body - pose.gyro_bias - earth_rate_body;
        let scaled = self.r_dvl_body * (1.0 + self.scale);
        // [l]×[ω]× = ω lᵀ − (l·ω) I.
        let mut by_attitude = so3::skew(&velocity_body) + earth_rate_body * arm.transpose();
        let turned_arm = arm.dot(&earth_rate_body);
        (0..3).for_each(|axis| by_attitude[(axis, axis)] -= turned_arm);
        let mut jacobian = SMatrix::<f64, 3, 9>::zeros();
        jacobian.fixed_columns_mut::<3>(VELOCITY).copy_from(&product_transposed(&scaled, &pose.r_enu_body));
        jacobian.fixed_columns_mut::<3>(ATTITUDE).copy_from(&product(&scaled, &by_attitude));
        Seen {
            residual: times(&scaled, &(velocity_body + rate_body.cross(arm))) - self.velocity_dvl,
            jacobian,
            covariance: self.covariance,
        }
    }

    /// s: h/(1 + s).
    fn calibration_jacobian(&self, residual: &Vector3<f64>) -> Vector3<f64> {
        (residual + self.velocity_dvl) / (1.0 + self.scale)
    }

    fn gyro_bias_jacobian(&self) -> Option<SMatrix<f64, 3, 3>> {
        Some(product_with_skew(&(self.r_dvl_body * (1.0 + self.scale)), &self.lever_arm_body))
    }
}
