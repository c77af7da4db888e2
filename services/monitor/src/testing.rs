//! Messages of a plausible run, and golden texts.

#![expect(clippy::unwrap_used, reason = "tests")]

use std::path::Path;

use nalgebra::Vector3;
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{
    BuoyFix, FACTORS_MAX, FactorReport, FrameOrigin, Header, Heartbeat, HopLatency, KeyframeReport, Mode, NavEstimate,
    Process, ProcessState, RejectReason, Sensor, SensorCounts, SensorHealth, Solution, Time, Truth,
};

use crate::detail::{Factor, KeyframeDetail};
use crate::model::Model;

const SECOND: i64 = 1_000_000_000;

pub(crate) const ORIGIN: [f64; 3] = [36.38, 127.36, 0.0];

/// The frame of every fixture.
pub(crate) fn frame() -> LocalFrame {
    LocalFrame::new(Geodetic::from_degrees(ORIGIN[0], ORIGIN[1], ORIGIN[2]))
}

/// Level, heading east at 1 m/s; 1-sigma 0.2, 0.25 and 0.1 m, uncorrelated.
pub(crate) fn estimate_at(t: f64, position_enu: [f64; 3]) -> NavEstimate {
    NavEstimate {
        header: Header::at(Time::from_seconds(t)),
        solution: 1,
        t_keyframe: 0,
        position_enu,
        velocity_enu: [1.0, 0.0, 0.0],
        q_enu_body: [1.0, 0.0, 0.0, 0.0],
        accel_bias: [0.0; 3],
        gyro_bias: [0.0; 3],
        position_cov: [0.04, 0.0, 0.0, 0.0625, 0.0, 0.01],
        velocity_cov: [1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4],
        attitude_cov: [1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-5],
        sigma_rpy: [1e-3, 1e-3, 3e-3],
        lat_lon_h: frame().to_geodetic(&Vector3::from(position_enu)).to_degrees(),
        aiding_age: [0.4, f64::INFINITY, 0.6, 0.1, 0.1],
        mode: Mode::Ok as u32,
        reserved: 0,
    }
}

/// A truth of the same attitude and velocity as [`estimate_at`].
pub(crate) fn truth_at(t: f64, position_enu: [f64; 3]) -> Truth {
    let [lat_deg, lon_deg, height] = frame().to_geodetic(&Vector3::from(position_enu)).to_degrees();
    Truth {
        header: Header::at(Time::from_seconds(t)),
        lat_deg,
        lon_deg,
        height,
        q_enu_body: [1.0, 0.0, 0.0, 0.0],
        velocity_enu: [1.0, 0.0, 0.0],
    }
}

/// A running process's own word, published at the monotonic time `at`, ns.
pub(crate) fn heartbeat(process: Process, at: i64) -> Heartbeat {
    Heartbeat {
        header: Header { source: process as u16, t_published: at, ..Header::default() },
        process: process as u32,
        state: ProcessState::Running as u32,
        pid: 4000 + process as u32,
        restarts: 0,
        cpu_ns: 0,
        resident_bytes: 12_300_000,
        dropped: 0,
        handled: 0,
        sensors: [SensorHealth::NONE; 7],
        hop_in: HopLatency::default(),
        end_to_end: HopLatency::default(),
        work: HopLatency::default(),
    }
}

/// What the supervisor says of another.
pub(crate) fn word_of_supervisor(process: Process, state: ProcessState, pid: u32, restarts: u32) -> Heartbeat {
    let mut word = heartbeat(process, 0);
    word.header.source = Process::Supervisor as u16;
    (word.state, word.pid, word.restarts, word.resident_bytes) = (state as u32, pid, restarts, 0);
    word
}

/// A solution of the keyframe at `t`.
pub(crate) fn solution_at(t: f64) -> Solution {
    let mut counts = [SensorCounts::default(); 7];
    for (sensor, used) in [(Sensor::Imu, 24_680), (Sensor::Lbl, 480), (Sensor::Dvl, 122), (Sensor::Ps, 1_234)] {
        counts[sensor.index()].used = used;
    }
    counts[Sensor::Lbl.index()].rejected[RejectReason::Gated.index()] = 9;
    Solution {
        header: Header::at(Time::from_seconds(t)),
        id: 123,
        t_keyframe: Time::from_seconds(t).0,
        origin: ORIGIN,
        t_last_used: [0; 5],
        counts,
        cost: 12.0,
        keyframes: 20,
        iterations: 2,
        linearised: 3,
        solve_ns: 123_456,
        ..Solution::empty()
    }
}

/// Its report: five ranges, of which one was refused, and a DVL velocity.
pub(crate) fn report_at(t: f64) -> KeyframeReport {
    let mut factors = [FactorReport::default(); FACTORS_MAX];
    for factor in &mut factors[..6] {
        let sensor = Sensor::Lbl as u32;
        *factor = FactorReport { sensor, rows: 1, nis: 0.95, gate: [-4.0, 5.0], ..FactorReport::default() };
    }
    let gate = [0.0, 16.266_f64.sqrt()];
    factors[4] = FactorReport { sensor: Sensor::Dvl as u32, rows: 3, nis: 2.85, gate, ..FactorReport::default() };
    factors[5] = FactorReport { refused: 1 + RejectReason::Gated as u32, nis: 40.0, ..factors[5] };
    KeyframeReport {
        header: Header::at(Time::from_seconds(t)),
        solution: 123,
        t_keyframe: Time::from_seconds(t).0,
        cost: [14.0, 12.0],
        iterations: 2,
        keyframes: 20,
        factor_count: 6,
        factors_left_out: 0,
        factors,
    }
}

/// A keyframe with two used ranges of NIS 1, a refused one of NIS 25, and a time offset of the LBL.
pub(crate) fn keyframe_at(t: f64) -> KeyframeDetail {
    let factor = |buoy: u32, whitened: f64, refused| Factor {
        sensor: Sensor::Lbl,
        t,
        rows: 1,
        buoy: Some(buoy),
        refused,
        whitened: vec![whitened],
        nis: whitened * whitened,
        weight: 1.0,
        gate: Some([-4.0, 5.0]),
    };
    KeyframeDetail {
        t,
        solution: t as u64,
        iterations: 2,
        window: 20,
        cost: [14.0, 12.0],
        solve: Some(123e-6),
        status: None,
        time_offsets: vec![[0.05, 0.01], [0.0; 2], [0.0; 2], [0.0; 2], [0.0; 2]],
        left_out: 0,
        factors: vec![factor(1, 1.0, None), factor(2, -1.0, None), factor(3, 5.0, Some("gated"))],
    }
}

fn readings(sensor: Sensor, rate: f64, t: f64, heartbeat: &mut Heartbeat) {
    let period = 1.0 / rate;
    let count = (t * rate).floor();
    let health = &mut heartbeat.sensors[sensor.index()];
    // Ranges come in fours.
    health.received = count as u64 * if sensor == Sensor::Lbl { 4 } else { 1 };
    health.t_newest = Time::from_seconds(count * period).0;
}

/// The heartbeats of everybody at the data time `t`, published at the monotonic time `at`, with the LBL heard until
/// `lbl_until`.
fn heartbeats(model: &mut Model, t: f64, at: i64, lbl_until: f64) {
    let cpu = |share: f64| (share * t * 1e9) as u64;
    model.heartbeat(&heartbeat(Process::Supervisor, at));
    for (process, share) in [(Process::EmulatorImu, 0.011), (Process::EmulatorLbl, 0.001), (Process::Recorder, 0.013)] {
        model.heartbeat(&Heartbeat { cpu_ns: cpu(share), ..heartbeat(process, at) });
    }
    let mut preprocessor = Heartbeat { cpu_ns: cpu(0.008), ..heartbeat(Process::Preprocessor, at) };
    for (sensor, rate) in [(Sensor::Imu, 200.0), (Sensor::Dvl, 1.0), (Sensor::Mcp, 10.0), (Sensor::Ps, 10.0)] {
        readings(sensor, rate, t, &mut preprocessor);
    }
    readings(Sensor::Lbl, 1.0, t.min(lbl_until), &mut preprocessor);
    preprocessor.sensors[Sensor::Dvl.index()].rejected[RejectReason::OutOfRange.index()] = 1;
    preprocessor.sensors[Sensor::Buoys.index()] = SensorHealth { received: 4, t_newest: 0, ..SensorHealth::NONE };
    model.heartbeat(&preprocessor);
    let work = HopLatency { count: 123, p50_ns: 118_000, p99_ns: 310_000, max_ns: 1_204_000, ..HopLatency::default() };
    model.heartbeat(&Heartbeat { work, cpu_ns: cpu(0.002), ..heartbeat(Process::Solver, at) });
    let end_to_end =
        HopLatency { count: 24_680, p50_ns: 45_000, p99_ns: 120_000, max_ns: 812_000, ..HopLatency::default() };
    model.heartbeat(&Heartbeat { end_to_end, cpu_ns: cpu(0.016), ..heartbeat(Process::Propagator, at) });
}

/// A run from `begin` to `end` s of data time, in real time, seen by a monitor.
fn run(begin: f64, end: f64, lbl_until: f64) -> Model {
    let mut model = Model::new("main");
    let [lat_deg, lon_deg, height] = ORIGIN;
    model.frame_origin(&FrameOrigin { header: Header::default(), lat_deg, lon_deg, height });
    for buoy in 1..=4 {
        let lat_deg = lat_deg + f64::from(buoy) * 1e-3;
        model.buoy(&BuoyFix { header: Header::default(), buoy, moored: 1, lat_deg, lon_deg, height });
    }
    let samples = ((end - begin) * 200.0).round() as u64;
    for sample in 0..=samples {
        let t = begin + sample as f64 * 0.005;
        let at = (t * 1e9).round() as i64;
        let mut estimate = estimate_at(t, [t - 100.0, 37.5, -52.25]);
        (estimate.header.sequence, estimate.header.t_published) = (sample, at);
        if t > lbl_until + 5.0 {
            estimate.mode = Mode::DeadReckoning as u32;
            estimate.aiding_age[0] = t - lbl_until;
        }
        model.estimate(&estimate);
        if sample % 20 == 0 {
            model.truth(&truth_at(t, [t - 100.061, 37.538, -52.262]));
            model.settle(at);
        }
        if sample % 100 == 0 {
            heartbeats(&mut model, t, at, lbl_until);
        }
    }
    model.solution(&solution_at(end - 0.4));
    model.diagnostics(&report_at(end - 0.4));
    model.settle((end * 1e9) as i64);
    model
}

/// Everything is well at 123.4 s.
pub(crate) fn mission_under_way() -> Model {
    run(93.4, 123.4, f64::INFINITY)
}

/// No LBL for 20 s, and the solver has just been killed.
pub(crate) fn mission_in_an_outage() -> Model {
    let mut model = run(93.4, 123.4, 103.0);
    model.heartbeat(&word_of_supervisor(Process::Propagator, ProcessState::Running, 4011, 0));
    model.heartbeat(&word_of_supervisor(Process::Solver, ProcessState::Restarting, 0, 0));
    model
}

/// Every number that can be none is none.
pub(crate) fn poisoned() -> Model {
    let mut model = mission_under_way();
    let mut solution = solution_at(123.0);
    (solution.origin, solution.status) = ([f64::NAN; 3], 77);
    model.solution(&solution);
    let mut report = report_at(123.0);
    (report.factors[0].nis, report.cost) = (f64::NAN, [f64::INFINITY; 2]);
    model.diagnostics(&report);
    let mut estimate = estimate_at(123.405, [f64::NAN, f64::INFINITY, f64::NEG_INFINITY]);
    estimate.velocity_enu = [f64::NAN; 3];
    estimate.position_cov = [f64::NAN, 0.0, 0.0, -1.0, 0.0, f64::INFINITY];
    estimate.sigma_rpy = [0.0, f64::NAN, f64::INFINITY];
    estimate.lat_lon_h = [f64::NAN; 3];
    estimate.aiding_age = [f64::NAN; 5];
    model.estimate(&estimate);
    // A sigma of nothing makes an error of infinitely many.
    let certain =
        NavEstimate { position_cov: [0.0; 6], sigma_rpy: [0.0; 3], ..estimate_at(123.41, [23.41, 37.5, -52.0]) };
    model.estimate(&certain);
    model.truth(&truth_at(123.41, [23.0, 37.0, -52.0]));
    model.settle(124_000_000_000);
    model.estimate(&NavEstimate { header: Header::at(Time::from_seconds(123.415)), ..estimate });
    model.settle(124_000_000_000 + SECOND);
    model
}

/// Compares with `src/golden/NAME`. With `ILNS_UPDATE_GOLDEN` set, that file is written instead.
pub(crate) fn assert_golden(name: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/golden").join(name);
    let text = format!("{text}\n");
    if std::env::var_os("ILNS_UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, &text).unwrap();
        return;
    }
    let golden = std::fs::read_to_string(&path).unwrap_or_default();
    for (index, (found, expected)) in text.lines().zip(golden.lines()).enumerate() {
        assert_eq!(found, expected, "{name}, line {}; the whole text is\n{text}", index + 1);
    }
    assert_eq!(text, golden, "{name} has another length; the whole text is\n{text}");
}
