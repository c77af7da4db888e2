//! A drive of KITTI raw: the inertial readings of its OXTS unit, and everything else from the unit's own output.

use ilns_recording::{OxtsSample, read_oxts};
use nalgebra::{UnitQuaternion, Vector3};
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{Duration, DvlVelocity, GnssFix, Header, ImuSample, PsDepth, Time};

use super::FolderArgs;
use super::log::{ConvertedLog, Facts, StateEnu, note_sorted};
use super::ranges::{Noise, Ping, RANGE_SIGMA, simulate};
use crate::error::ReplayError;

/// Between two fixes, and between two epochs of ranges.
const SECOND: Duration = Duration(1_000_000_000);
/// Between two velocities, depths.
const FIFTH: Duration = Duration(200_000_000);
/// Between two rows of the truth.
const TENTH: Duration = Duration(100_000_000);
/// Slower inertial data are no inertial navigation: between samples of 10 Hz a car turns by degrees.
const PERIOD_MAX: Duration = Duration(50_000_000);
/// A longer step is a hole worth a word.
const HOLE: Duration = Duration(100_000_000);
const DVL_SIGMA: f64 = 0.05;
const PS_SIGMA: f64 = 0.05;

pub(super) fn convert(args: &FolderArgs) -> Result<Vec<String>, ReplayError> {
    let drive = read_oxts(&args.dir)?;
    let samples = &drive.samples;
    let mut steps: Vec<Duration> = samples.windows(2).map(|pair| pair[1].t - pair[0].t).collect();
    let holes = steps.iter().filter(|step| **step > HOLE).count();
    steps.sort();
    let period = steps.get(steps.len() / 2).copied().unwrap_or(Duration(i64::MAX));
    if period > PERIOD_MAX {
        return Err(ReplayError::SlowImu { dir: args.dir.clone(), period_s: period.as_seconds() });
    }
    let mut notes = vec![format!(
        "KITTI raw drive {}: real inertial readings of the OXTS unit; lbl.csv, buoys.csv (seed {}), dvl.csv and ps.csv are simulated from \
         the unit's filtered output with noise; gnss.csv and truth.csv are that output, so that the truth is not independent",
        args.dir.display(),
        args.seed
    )];
    note_sorted(&mut notes, "timestamps.txt", drive.out_of_order);
    if holes > 0 {
        notes.push(format!("timestamps.txt: {holes} holes of more than {} s", HOLE.as_seconds()));
    }
    let first = &samples[0];
    let [lat, lon, height] = first.lat_lon_h;
    let origin = Geodetic::from_degrees(lat, lon, height);
    let log = log_of(samples, &LocalFrame::new(origin), height, args.seed);
    let facts = Facts {
        origin,
        surface_height: height,
        initial: Some((state(first, &LocalFrame::new(origin)), [0.5, 0.5, 1.0])),
        lbl_lever_arm: Vector3::zeros(),
        gnss_lever_arm: Vector3::zeros(),
        dvl_lever_arm: Vector3::zeros(),
        dvl_mounting_rpy_deg: [0.0; 3],
        dvl_sigma: DVL_SIGMA,
        ps_sigma: PS_SIGMA,
    };
    log.write(args, &facts.sensors_toml(&notes))?;
    Ok(notes)
}

fn log_of(samples: &[OxtsSample], frame: &LocalFrame, surface_height: f64, seed: u64) -> ConvertedLog {
    let mut noise = Noise::new(seed, 2);
    let mut log = ConvertedLog::default();
    let mut pings = Vec::new();
    let [mut fixes, mut velocities, mut depths, mut truths] = [SECOND, FIFTH, FIFTH, TENTH].map(Every::new);
    for sample in samples {
        let (header, [lat_deg, lon_deg, height]) = (Header::at(sample.t), sample.lat_lon_h);
        log.imu.push(ImuSample { header, gyro_body: sample.gyro_body, accel_body: sample.accel_body });
        let state = state(sample, frame);
        if fixes.is_due(sample.t) {
            let sigma = sample.position_accuracy;
            log.gnss.push(GnssFix { header, lat_deg, lon_deg, height, sigma_enu: [sigma, sigma, 2.0 * sigma] });
            let transducer = Geodetic::from_degrees(lat_deg, lon_deg, height);
            pings.push(Ping { t: sample.t, transducer, sigma: RANGE_SIGMA, lost: 0.0 });
        }
        if let Some(velocity_enu) = state.velocity_enu.filter(|_| velocities.is_due(sample.t)) {
            let velocity_body = state.q_enu_body.inverse() * velocity_enu;
            let velocity_dvl = [0, 1, 2].map(|axis| velocity_body[axis] + noise.normal(DVL_SIGMA));
            log.dvl.push(DvlVelocity { header, velocity_dvl });
        }
        if depths.is_due(sample.t) {
            log.ps.push(PsDepth { header, depth: surface_height - height + noise.normal(PS_SIGMA) });
        }
        if truths.is_due(sample.t) {
            log.truth.push(state.truth(frame));
        }
    }
    (log.buoys, log.lbl) = simulate(&pings, frame, seed);
    log
}

/// R(body to local ENU) = Rz(yaw) Ry(pitch) Rx(roll); local axes differ from those at the origin by the Earth's curvature.
fn state(sample: &OxtsSample, frame: &LocalFrame) -> StateEnu {
    let [lat, lon, height] = sample.lat_lon_h;
    let position_enu = frame.to_enu(&Geodetic::from_degrees(lat, lon, height));
    let local_axes = frame.local_axes_at(&position_enu);
    let [roll, pitch, yaw] = sample.roll_pitch_yaw;
    StateEnu {
        t: sample.t,
        position_enu,
        q_enu_body: UnitQuaternion::from_matrix(&local_axes) * UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        velocity_enu: Some(local_axes * Vector3::from(sample.velocity_enu)),
    }
}

/// Thins a series to a rate.
struct Every {
    period: Duration,
    due: Time,
}

impl Every {
    fn new(period: Duration) -> Every {
        Every { period, due: Time::MIN }
    }

    fn is_due(&mut self, t: Time) -> bool {
        let is_due = t >= self.due;
        if is_due {
            self.due = t + self.period;
        }
        is_due
    }
}
