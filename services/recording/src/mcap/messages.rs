//! Our values as the text of their messages.

use shared_types::{
    FactorReport, GnssFix, Heartbeat, HopLatency, KeyframeReport, NavEstimate, Process, ProcessState, RejectReason,
    Sensor,
};

use super::json::Object;
use crate::rows::{LogRow, push_row};

/// REP-105's fixed frame: ENU at the origin of the run.
pub(crate) const MAP: &str = "map";
/// REP-103's body frame: forward, left, up.
pub(crate) const BASE_LINK: &str = "base_link";

/// A row of the log directory: its columns as keys, its cells as values.
pub(crate) fn row<R: LogRow>(text: &mut Vec<u8>, scratch: &mut Vec<u8>, row: &R) {
    scratch.clear();
    push_row(scratch, row, true);
    let cells = scratch.trim_ascii_end().split(|&byte| byte == b',');
    Object::write(text, |object| {
        for (column, cell) in R::COLUMNS.iter().chain(R::RECORDED).zip(cells) {
            object.cell(column, cell);
        }
    });
}

pub(crate) fn estimate(text: &mut Vec<u8>, estimate: &NavEstimate) {
    let sigma_enu = [estimate.position_cov[0], estimate.position_cov[3], estimate.position_cov[5]].map(f64::sqrt);
    Object::write(text, |object| {
        object.seconds("t", estimate.header.t_valid);
        object.word("mode", estimate.mode().name());
        object.whole("solution", estimate.solution);
        object.numbers(["e", "n", "u"], estimate.position_enu);
        object.numbers(["qw", "qx", "qy", "qz"], estimate.q_enu_body);
        object.numbers(["ve", "vn", "vu"], estimate.velocity_enu);
        object.numbers(["bax", "bay", "baz"], estimate.accel_bias);
        object.numbers(["bgx", "bgy", "bgz"], estimate.gyro_bias);
        object.numbers(["se", "sn", "su"], sigma_enu);
        object.numbers(["sroll", "spitch", "syaw"], estimate.sigma_rpy);
        object.numbers(["lat", "lon", "h"], estimate.lat_lon_h);
    });
}

fn vector(object: &mut Object<'_>, key: &str, vector: [f64; 3]) {
    object.object(key, |object| object.numbers(["x", "y", "z"], vector));
}

fn rotation(object: &mut Object<'_>, key: &str, [w, x, y, z]: [f64; 4]) {
    object.object(key, |object| object.numbers(["x", "y", "z", "w"], [x, y, z, w]));
}

pub(crate) fn pose_in_frame(text: &mut Vec<u8>, estimate: &NavEstimate) {
    Object::write(text, |object| {
        object.stamp("timestamp", estimate.header.t_valid);
        object.word("frame_id", MAP);
        object.object("pose", |pose| {
            vector(pose, "position", estimate.position_enu);
            rotation(pose, "orientation", estimate.q_enu_body);
        });
    });
}

pub(crate) fn transforms(text: &mut Vec<u8>, estimate: &NavEstimate) {
    Object::write(text, |object| {
        object.list("transforms", [estimate], |object, estimate| {
            object.stamp("timestamp", estimate.header.t_valid);
            object.word("parent_frame_id", MAP);
            object.word("child_frame_id", BASE_LINK);
            vector(object, "translation", estimate.position_enu);
            rotation(object, "rotation", estimate.q_enu_body);
        });
    });
}

/// Foxglove's code for a covariance that is known in full, and for one of which only the diagonal is.
const COVARIANCE_KNOWN: u64 = 3;
const COVARIANCE_DIAGONAL: u64 = 2;

pub(crate) fn location(text: &mut Vec<u8>, estimate: &NavEstimate) {
    let [ee, en, eu, nn, nu, uu] = estimate.position_cov;
    Object::write(text, |object| {
        object.stamp("timestamp", estimate.header.t_valid);
        object.word("frame_id", BASE_LINK);
        object.numbers(["latitude", "longitude", "altitude"], estimate.lat_lon_h);
        object.array("position_covariance", &[ee, en, eu, en, nn, nu, eu, nu, uu]);
        object.whole("position_covariance_type", COVARIANCE_KNOWN);
    });
}

/// A fix of the antenna, where it says where it is.
pub(crate) fn gnss_location(text: &mut Vec<u8>, fix: &GnssFix) {
    let [ee, nn, uu] = fix.sigma_enu.map(|sigma| sigma * sigma);
    let is_known = (ee + nn + uu).is_finite();
    Object::write(text, |object| {
        object.stamp("timestamp", fix.header.t_valid);
        object.word("frame_id", BASE_LINK);
        object.numbers(["latitude", "longitude", "altitude"], [fix.lat_deg, fix.lon_deg, fix.height]);
        let diagonal = [ee, 0.0, 0.0, 0.0, nn, 0.0, 0.0, 0.0, uu];
        object.array("position_covariance", if is_known { &diagonal } else { &[0.0; 9] });
        object.whole("position_covariance_type", if is_known { COVARIANCE_DIAGONAL } else { 0 });
    });
}

pub(crate) fn frame_origin(text: &mut Vec<u8>, origin: [f64; 3]) {
    Object::write(text, |object| object.numbers(["lat", "lon", "h"], origin));
}

pub(crate) fn keyframe_report(text: &mut Vec<u8>, report: &KeyframeReport) {
    let used = report.factors.len().min(report.factor_count as usize);
    Object::write(text, |object| {
        object.seconds("t_keyframe", report.t_keyframe);
        object.whole("solution", report.solution);
        object.numbers(["cost_before", "cost_after"], report.cost);
        object.whole("iterations", report.iterations.into());
        object.whole("keyframes", report.keyframes.into());
        object.whole("factors_left_out", report.factors_left_out.into());
        object.list("factors", &report.factors[..used], factor);
    });
}

fn factor(object: &mut Object<'_>, factor: &FactorReport) {
    let rows = factor.whitened.len().min(factor.rows as usize);
    object.seconds("t", factor.t_valid);
    object.word("sensor", Sensor::from_index(factor.sensor).map_or("unknown", Sensor::name));
    object.whole("buoy", factor.buoy.into());
    if factor.refused > 0 {
        let reason = RejectReason::from_index(factor.refused - 1).map_or("unknown", RejectReason::name);
        object.word("refused", reason);
    }
    object.numbers(["nis", "weight"], [factor.nis, factor.weight]);
    object.array("whitened", &factor.whitened[..rows]);
    if factor.gate != [0.0; 2] {
        object.array("gate", &factor.gate);
    }
}

pub(crate) fn heartbeat(text: &mut Vec<u8>, beat: &Heartbeat) {
    let hop = |object: &mut Object<'_>, keys: [&str; 3], hop: &HopLatency| {
        if hop.count > 0 {
            object.numbers(keys, [hop.p50_ns, hop.p99_ns, hop.max_ns].map(|ns| ns as f64 * 1e-3));
        }
    };
    Object::write(text, |object| {
        object.word("process", Process::from_index(beat.process).map_or("unknown", Process::name));
        object.word("state", ProcessState::from_index(beat.state).map_or("unknown", ProcessState::name));
        object.whole("pid", beat.pid.into());
        object.whole("restarts", beat.restarts.into());
        object.number("cpu_s", beat.cpu_ns as f64 * 1e-9);
        object.whole("resident_bytes", beat.resident_bytes);
        object.whole("handled", beat.handled);
        object.whole("dropped", beat.dropped);
        hop(object, ["hop_in_p50_us", "hop_in_p99_us", "hop_in_max_us"], &beat.hop_in);
        hop(object, ["end_to_end_p50_us", "end_to_end_p99_us", "end_to_end_max_us"], &beat.end_to_end);
        hop(object, ["work_p50_us", "work_p99_us", "work_max_us"], &beat.work);
    });
}
