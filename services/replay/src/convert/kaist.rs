//! A sequence of KAIST complex urban.
//!
//! Body axes and origin are those of the IMU. The wheel encoders give the speed of the rear axle, the origin of the vehicle's
//! frame, forward; that it goes neither sideways nor up is what a car adds. Ranges are simulated from the positions of the VRS-RTK
//! receiver, as the paper did: they become worse and fewer where its fix does, and fail where it has none.

use std::path::Path;

use ilns_recording::{
    ForeignRows, KaistEncoder, KaistMounting, LogError, kaist_altimeter, kaist_encoder, kaist_encoder_parameters,
    kaist_global_pose, kaist_gps, kaist_imu, kaist_mounting, kaist_vrs,
};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use nav_geometry::{Geodetic, LocalFrame, UtmZone};
use shared_types::{Duration, DvlVelocity, GnssFix, Header, ImuSample, PsDepth, Time};

use super::FolderArgs;
use super::log::{ConvertedLog, Facts, StateEnu, note_sorted};
use super::ranges::{Ping, RANGE_SIGMA, simulate};
use crate::error::ReplayError;

/// All sequences were driven there.
const ZONE: UtmZone = UtmZone { number: 52, is_north: true };
/// Counts are differenced over so long: a step of the encoder is then 5 mm/s.
const SPEED_OVER: Duration = Duration(100_000_000);
/// Faster is a counter that began again, m/s.
const SPEED_MAX: f64 = 60.0;
/// Of the speed, and of the car's going neither sideways nor up, m/s.
const DVL_SIGMA: f64 = 0.1;
/// A barometer in the open, m.
const PS_SIGMA: f64 = 1.0;
/// Fixes that tie the barometer to the heights of the receiver.
const BAROMETER_FIXES: usize = 10;
/// Truth rows are at least so far apart.
const TRUTH_PERIOD: Duration = Duration(100_000_000);
/// A file that ends so much before the IMU is worth a word.
const SHORT: Duration = Duration(10_000_000_000);

/// 1-sigma of a range (m) and the share of ranges that are lost, by the state of the fix: 4 fixed, 5 float, 1 single.
fn quality(fix_state: f64) -> Option<(f64, f64)> {
    match fix_state as i64 {
        4 => Some((RANGE_SIGMA, 0.0)),
        5 => Some((1.5, 0.3)),
        1 => Some((5.0, 0.6)),
        _ => None,
    }
}

/// What a sequence holds, as far as it is there.
struct Sequence {
    imu: ForeignRows<6>,
    vrs: ForeignRows<7>,
    gps: Option<ForeignRows<6>>,
    encoder: Option<(ForeignRows<2>, KaistEncoder)>,
    altimeter: Option<ForeignRows<1>>,
    pose: Option<ForeignRows<12>>,
    imu_mounting: Mounting,
    vrs_mounting: Mounting,
}

/// p_vehicle = R p_sensor + T.
#[derive(Clone, Copy)]
struct Mounting {
    rotation: UnitQuaternion<f64>,
    translation: Vector3<f64>,
}

impl Mounting {
    fn new(mounting: &KaistMounting) -> Mounting {
        Mounting { rotation: rotation(&mounting.rotation), translation: mounting.translation.into() }
    }

    /// A point of the vehicle in the sensor's frame.
    fn in_sensor(&self, point_vehicle: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse() * (point_vehicle - self.translation)
    }
}

/// The rotation nearest to nine printed numbers, row by row.
fn rotation(rows: &[f64; 9]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&Matrix3::from_row_slice(rows)))
}

pub(super) fn convert(args: &FolderArgs) -> Result<Vec<String>, ReplayError> {
    let mut notes = vec![format!(
        "KAIST complex urban sequence {}: real IMU and encoders; lbl.csv and buoys.csv are simulated from vrs_gps.csv (seed {}): 0.3 m \
         where the fix is fixed, 1.5 m and 30 % lost where it floats, 5 m and 60 % lost where it is single, none without",
        args.dir.display(),
        args.seed
    )];
    let sequence = Sequence::read(&args.dir, &mut notes)?;
    let (log, facts) = sequence.log(args, &mut notes)?;
    log.write(args, &facts.sensors_toml(&notes))?;
    Ok(notes)
}

/// What a file gives; a missing one leaves `consequence` in the notes.
fn optional<T>(
    file: &Path,
    read: impl FnOnce(&Path) -> Result<T, LogError>,
    consequence: &str,
    notes: &mut Vec<String>,
) -> Result<Option<T>, LogError> {
    if file.exists() {
        return read(file).map(Some);
    }
    notes.push(format!("{} is missing: {consequence}", file.display()));
    Ok(None)
}

/// Says that rows were sorted, and that a file ends before the IMU does.
fn note_state<const N: usize>(notes: &mut Vec<String>, file: &str, rows: Option<&ForeignRows<N>>, end: Time) {
    let Some(rows) = rows else { return };
    note_sorted(notes, file, rows.out_of_order);
    if let Some(last) = rows.rows.last().filter(|last| end - last.0 > SHORT) {
        notes.push(format!("{file} ends {:.1} s before xsens_imu.csv", (end - last.0).as_seconds()));
    }
}

impl Sequence {
    fn read(dir: &Path, notes: &mut Vec<String>) -> Result<Sequence, LogError> {
        let (data, calibration) = (dir.join("sensor_data"), dir.join("calibration"));
        let imu = kaist_imu(data.join("xsens_imu.csv"))?;
        let vrs = kaist_vrs(data.join("vrs_gps.csv"))?;
        let gps = optional(&data.join("gps.csv"), |file| kaist_gps(file), "no gnss.csv", notes)?;
        let counts = optional(&data.join("encoder.csv"), |file| kaist_encoder(file), "no dvl.csv", notes)?;
        let parameters = calibration.join("EncoderParameter.txt");
        let encoder = match counts {
            None => None,
            Some(counts) => {
                let why = "no dvl.csv (the wheels' size differs by sequence)";
                let parameters = optional(&parameters, |file| kaist_encoder_parameters(file), why, notes)?;
                parameters.map(|parameters| (counts, parameters))
            }
        };
        let altimeter = optional(&data.join("altimeter.csv"), |file| kaist_altimeter(file), "no ps.csv", notes)?;
        let why = "truth.csv is the fixed positions of vrs_gps.csv, without attitude, and the first state is found from the data";
        let pose = optional(&dir.join("global_pose.csv"), |file| kaist_global_pose(file), why, notes)?;
        let mut mounting = |name: &str| {
            let why = "the sensor is taken to sit at the vehicle's origin, axes alike";
            let mounting = optional(&calibration.join(name), |file| kaist_mounting(file), why, notes)?;
            Ok::<_, LogError>(Mounting::new(&mounting.unwrap_or(KaistMounting::IDENTITY)))
        };
        let (imu_mounting, vrs_mounting) = (mounting("Vehicle2IMU.txt")?, mounting("Vehicle2VRS.txt")?);
        let end = imu.rows.last().map_or(Time::MIN, |row| row.0);
        note_state(notes, "xsens_imu.csv", Some(&imu), end);
        note_state(notes, "vrs_gps.csv", Some(&vrs), end);
        note_state(notes, "gps.csv", gps.as_ref(), end);
        note_state(notes, "encoder.csv", encoder.as_ref().map(|(counts, _)| counts), end);
        note_state(notes, "altimeter.csv", altimeter.as_ref(), end);
        note_state(notes, "global_pose.csv", pose.as_ref(), end);
        Ok(Sequence { imu, vrs, gps, encoder, altimeter, pose, imu_mounting, vrs_mounting })
    }

    fn log(&self, args: &FolderArgs, notes: &mut Vec<String>) -> Result<(ConvertedLog, Facts), ReplayError> {
        let (Some(begin), Some(end)) = (self.imu.rows.first(), self.imu.rows.last()) else {
            return Err(ReplayError::NothingToRangeFrom { dir: args.dir.clone() });
        };
        let within = |t: Time| begin.0 <= t && t <= end.0;
        let pings: Vec<Ping> = self.vrs.rows.iter().filter(|row| within(row.0)).filter_map(ping).collect();
        let first_fixed = pings.iter().find(|ping| ping.sigma == RANGE_SIGMA);
        let Some(first) = first_fixed else {
            return Err(ReplayError::NothingToRangeFrom { dir: args.dir.clone() });
        };
        // Heights of a city are far above the sea: the surface lies where the drive begins.
        let (origin, surface_height) = (first.transducer, first.transducer.height);
        let frame = LocalFrame::new(origin);
        let states = self.states(&frame, notes);
        let (buoys, lbl) = simulate(&pings, &frame, args.seed);
        let mut log = ConvertedLog { buoys, lbl, imu: self.imu(), gnss: self.gnss(), ..ConvertedLog::default() };
        log.dvl =
            self.encoder.as_ref().map(|(counts, parameters)| speeds(counts, parameters, notes)).unwrap_or_default();
        log.ps = self.altimeter.as_ref().map(|rows| depths(rows, &pings, surface_height)).unwrap_or_default();
        log.truth = match &states {
            Some(states) => thinned(states).map(|state| state.truth(&frame)).collect(),
            None => pings.iter().filter(|ping| ping.sigma == RANGE_SIGMA).map(truth_of_ping).collect(),
        };
        let lever_arm = |mounting: &Mounting| self.imu_mounting.in_sensor(&mounting.translation);
        let [roll, pitch, yaw]: [f64; 3] = self.imu_mounting.rotation.inverse().euler_angles().into();
        let facts = Facts {
            origin,
            surface_height,
            initial: states.and_then(|states| Some((first_state(&states, begin.0)?, [1.0, 1.0, 2.0]))),
            lbl_lever_arm: lever_arm(&self.vrs_mounting),
            gnss_lever_arm: lever_arm(&self.vrs_mounting),
            dvl_lever_arm: self.imu_mounting.in_sensor(&Vector3::zeros()),
            dvl_mounting_rpy_deg: [roll, pitch, yaw].map(f64::to_degrees),
            dvl_sigma: DVL_SIGMA,
            ps_sigma: PS_SIGMA,
        };
        Ok((log, facts))
    }

    fn imu(&self) -> Vec<ImuSample> {
        let sample = |&(t, [gx, gy, gz, ax, ay, az]): &(Time, [f64; 6])| ImuSample {
            header: Header::at(t),
            gyro_body: [gx, gy, gz],
            accel_body: [ax, ay, az],
        };
        self.imu.rows.iter().map(sample).collect()
    }

    fn gnss(&self) -> Vec<GnssFix> {
        let fix = |&(t, [lat_deg, lon_deg, height, var_e, var_n, var_u]): &(Time, [f64; 6])| GnssFix {
            header: Header::at(t),
            lat_deg,
            lon_deg,
            height,
            // A receiver that reports no variance says 0.
            sigma_enu: [var_e, var_n, var_u].map(|var| if var > 0.0 { var.sqrt() } else { f64::NAN }),
        };
        self.gps.iter().flat_map(|gps| gps.rows.iter().map(fix)).collect()
    }

    /// The reference, moved to the IMU and turned from the grid's axes to those of the log.
    fn states(&self, frame: &LocalFrame, notes: &mut Vec<String>) -> Option<Vec<StateEnu>> {
        let pose = self.pose.as_ref()?;
        let datum = self.height_above_reference(pose);
        notes.push(format!(
            "global_pose.csv: heights moved by {datum:.2} m to those of vrs_gps.csv; velocities are not reported"
        ));
        let state = |&(t, m): &(Time, [f64; 12])| {
            let q_grid_vehicle = rotation(&[m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]);
            let imu_grid = Vector3::new(m[3], m[7], m[11]) + q_grid_vehicle * self.imu_mounting.translation;
            let point = ZONE.to_geodetic(imu_grid.x, imu_grid.y, imu_grid.z + datum);
            let position_enu = frame.to_enu(&point);
            let q_local_grid = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -ZONE.convergence(&point));
            let q_enu_local = UnitQuaternion::from_matrix(&frame.local_axes_at(&position_enu));
            let q_enu_body = q_enu_local * q_local_grid * q_grid_vehicle * self.imu_mounting.rotation;
            StateEnu { t, position_enu, q_enu_body, velocity_enu: None }
        };
        Some(pose.rows.iter().map(state).collect())
    }

    /// Median of the receiver's height less the antenna's by the reference, over fixed positions, m.
    fn height_above_reference(&self, pose: &ForeignRows<12>) -> f64 {
        let fixed = self.vrs.rows.iter().filter(|(_, fix)| fix[3] as i64 == 4);
        let differences = fixed.filter_map(|&(t, fix)| {
            let at = pose.rows.partition_point(|row| row.0 < t);
            let (_, m) = pose.rows.get(at)?;
            let antenna = self.vrs_mounting.translation;
            Some(fix[2] - (m[11] + m[8] * antenna.x + m[9] * antenna.y + m[10] * antenna.z))
        });
        median(differences.collect()).unwrap_or(0.0)
    }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

fn ping(row: &(Time, [f64; 7])) -> Option<Ping> {
    let &(t, [lat, lon, height, fix_state, ..]) = row;
    let (sigma, lost) = quality(fix_state)?;
    let is_finite = lat.is_finite() && lon.is_finite() && height.is_finite();
    is_finite.then(|| Ping { t, transducer: Geodetic::from_degrees(lat, lon, height), sigma, lost })
}

fn truth_of_ping(ping: &Ping) -> shared_types::Truth {
    let [lat_deg, lon_deg, height] = ping.transducer.to_degrees();
    shared_types::Truth {
        header: Header::at(ping.t),
        lat_deg,
        lon_deg,
        height,
        q_enu_body: [f64::NAN; 4],
        velocity_enu: [f64::NAN; 3],
    }
}

fn thinned(states: &[StateEnu]) -> impl Iterator<Item = &StateEnu> {
    let mut due = Time::MIN;
    states.iter().filter(move |state| {
        let is_due = state.t >= due;
        if is_due {
            due = state.t + TRUTH_PERIOD;
        }
        is_due
    })
}

/// The first state within the IMU's time, with the velocity to one a second later.
fn first_state(states: &[StateEnu], begin: Time) -> Option<StateEnu> {
    const LATER: Duration = Duration(1_000_000_000);
    let first = states.iter().find(|state| state.t >= begin)?;
    let later = states.iter().find(|state| state.t >= first.t + LATER)?;
    let velocity_enu = (later.position_enu - first.position_enu) / (later.t - first.t).as_seconds();
    Some(StateEnu { velocity_enu: Some(velocity_enu), ..*first })
}

/// Mean of both wheels over a tenth of a second, at its middle.
fn speeds(counts: &ForeignRows<2>, parameters: &KaistEncoder, notes: &mut Vec<String>) -> Vec<DvlVelocity> {
    let metres = |counts: f64, diameter: f64| counts / parameters.resolution * std::f64::consts::PI * diameter;
    let (mut velocities, mut refused) = (Vec::new(), 0);
    let mut rows = counts.rows.iter();
    let Some(mut from) = rows.next() else { return velocities };
    for to in rows {
        let span = to.0 - from.0;
        if span < SPEED_OVER {
            continue;
        }
        let left = metres(to.1[0] - from.1[0], parameters.left_diameter);
        let right = metres(to.1[1] - from.1[1], parameters.right_diameter);
        let speed = (left + right) / 2.0 / span.as_seconds();
        if speed.abs() <= SPEED_MAX {
            let header = Header::at(from.0 + Duration(span.0 / 2));
            velocities.push(DvlVelocity { header, velocity_dvl: [speed, 0.0, 0.0] });
        } else {
            refused += 1;
        }
        from = to;
    }
    if refused > 0 {
        notes.push(format!(
            "encoder.csv: {refused} speeds beyond {SPEED_MAX} m/s were left out (did a counter begin again?)"
        ));
    }
    velocities
}

/// Below the surface; the barometer is tied to the heights of the first fixes, as a pressure sensor is set to zero on deck.
fn depths(rows: &ForeignRows<1>, pings: &[Ping], surface_height: f64) -> Vec<PsDepth> {
    let fixed = pings.iter().filter(|ping| ping.sigma == RANGE_SIGMA).take(BAROMETER_FIXES);
    let differences = fixed.filter_map(|ping| {
        let at = rows.rows.partition_point(|row| row.0 < ping.t);
        Some(ping.transducer.height - rows.rows.get(at)?.1[0])
    });
    let offset = median(differences.collect()).unwrap_or(0.0);
    let depth = |&(t, [altitude]): &(Time, [f64; 1])| PsDepth {
        header: Header::at(t),
        depth: surface_height - (altitude + offset),
    };
    rows.rows.iter().map(depth).collect()
}
