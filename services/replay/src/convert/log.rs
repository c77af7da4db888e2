//! What every conversion writes: readings in order of time, a truth, and a `sensors.toml` that says what is what.

use ilns_recording::{LogError, LogWriter, LogWriterOptions};
use nalgebra::{UnitQuaternion, Vector3};
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{BuoyFix, DvlVelocity, GnssFix, Header, ImuSample, LblRange, PsDepth, Time, Truth};

use super::FolderArgs;

/// A log in memory. Each sensor's readings are in order of time.
#[derive(Default)]
pub(super) struct ConvertedLog {
    pub(super) imu: Vec<ImuSample>,
    pub(super) buoys: Vec<BuoyFix>,
    pub(super) lbl: Vec<LblRange>,
    pub(super) gnss: Vec<GnssFix>,
    pub(super) dvl: Vec<DvlVelocity>,
    pub(super) ps: Vec<PsDepth>,
    pub(super) truth: Vec<Truth>,
}

impl ConvertedLog {
    pub(super) fn write(&self, args: &FolderArgs, sensors_toml: &str) -> Result<(), LogError> {
        let options = LogWriterOptions { arrival_columns: false, replace: args.replace };
        let mut writer = LogWriter::create(&args.out, options)?;
        writer.sensors_toml(sensors_toml)?;
        self.imu.iter().try_for_each(|row| writer.imu(row))?;
        self.buoys.iter().try_for_each(|row| writer.buoy(row))?;
        self.lbl.iter().try_for_each(|row| writer.lbl(row))?;
        self.gnss.iter().try_for_each(|row| writer.gnss(row))?;
        self.dvl.iter().try_for_each(|row| writer.dvl(row))?;
        self.ps.iter().try_for_each(|row| writer.ps(row))?;
        self.truth.iter().try_for_each(|row| writer.truth(row))?;
        writer.finish()
    }
}

/// The vehicle at one instant, in the ENU frame of the log.
#[derive(Clone, Copy, Debug)]
pub(super) struct StateEnu {
    pub(super) t: Time,
    pub(super) position_enu: Vector3<f64>,
    pub(super) q_enu_body: UnitQuaternion<f64>,
    pub(super) velocity_enu: Option<Vector3<f64>>,
}

impl StateEnu {
    pub(super) fn truth(&self, frame: &LocalFrame) -> Truth {
        let [lat_deg, lon_deg, height] = frame.to_geodetic(&self.position_enu).to_degrees();
        let q = self.q_enu_body;
        Truth {
            header: Header::at(self.t),
            lat_deg,
            lon_deg,
            height,
            q_enu_body: [q.w, q.i, q.j, q.k],
            velocity_enu: self.velocity_enu.map_or([f64::NAN; 3], Into::into),
        }
    }
}

/// Facts of the vehicle for `sensors.toml`.
pub(super) struct Facts {
    pub(super) origin: Geodetic,
    pub(super) surface_height: f64,
    /// State, and 1-sigma of attitude, deg.
    pub(super) initial: Option<(StateEnu, [f64; 3])>,
    pub(super) lbl_lever_arm: Vector3<f64>,
    pub(super) gnss_lever_arm: Vector3<f64>,
    pub(super) dvl_lever_arm: Vector3<f64>,
    /// Roll, pitch, yaw of the odometer in the body frame, deg.
    pub(super) dvl_mounting_rpy_deg: [f64; 3],
    pub(super) dvl_sigma: f64,
    pub(super) ps_sigma: f64,
}

impl Facts {
    /// The file; `notes` are its head.
    pub(super) fn sensors_toml(&self, notes: &[String]) -> String {
        let three = |v: &Vector3<f64>| format!("[{:?}, {:?}, {:?}]", v.x, v.y, v.z);
        let [lat, lon, height] = self.origin.to_degrees();
        let mut text: String = notes.iter().map(|note| format!("# {note}\n")).collect();
        text += &format!(
            "\n[frame]\norigin = [{lat:?}, {lon:?}, {height:?}]\nsurface_height = {:?}\n",
            self.surface_height
        );
        if let Some((state, sigma_attitude)) = &self.initial {
            let q = state.q_enu_body;
            text += &format!("\n[initial]                          # from the reference\nt = {}\n", decimal(state.t));
            text += &format!("position = {}\n", three(&state.position_enu));
            if let Some(velocity) = &state.velocity_enu {
                text += &format!("velocity = {}\n", three(velocity));
            }
            text += &format!("quaternion = [{:?}, {:?}, {:?}, {:?}]\n", q.w, q.i, q.j, q.k);
            text += &format!("sigma_position = 0.5\nsigma_velocity = 0.3\nsigma_attitude = {sigma_attitude:?}\n");
        }
        // White noise that the vibration of a car makes of the instrument's own; biases that its temperature moves.
        text += "\n[imu]\ngyro_noise_density = 1.0e-3\naccel_noise_density = 2.0e-2\ngyro_bias_random_walk = 2.0e-5\n\
                 accel_bias_random_walk = 5.0e-4\ngyro_bias_sigma = 5.0e-3\naccel_bias_sigma = 0.3\n";
        text +=
            &format!("\n[lbl]\nsigma = {:?}\nlever_arm = {}\n", super::ranges::RANGE_SIGMA, three(&self.lbl_lever_arm));
        text += &format!("\n[gnss]\nlever_arm = {}\n", three(&self.gnss_lever_arm));
        text += &format!("\n[dvl]\nsigma = {:?}\nlever_arm = {}\n", self.dvl_sigma, three(&self.dvl_lever_arm));
        text += &format!("mounting_rpy = {:?}\n", self.dvl_mounting_rpy_deg);
        text + &format!("\n[ps]\nsigma = {:?}\n", self.ps_sigma)
    }
}

/// A TOML float keeps 15 digits: of a Unix time the microseconds, which is near enough for a start.
fn decimal(t: Time) -> String {
    let text = t.to_string();
    if text.contains('.') { text } else { text + ".0" }
}

/// `count` rows of `file` were out of order.
pub(super) fn note_sorted(notes: &mut Vec<String>, file: &str, count: u64) {
    if count > 0 {
        notes.push(format!("{file}: {count} rows stood after a later one and were sorted"));
    }
}
