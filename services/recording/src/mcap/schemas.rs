//! JSON schemas of the messages: Foxglove's own for what its panels draw, ours with units for the rest.
//!
//! Foxglove's are those of its published schemas, without the prose. Its parser knows one type per value: what may be
//! missing is therefore missing, and never `null` or a text.

use crate::rows::LogRow;

/// Meaning and unit of a column of the log directory.
fn meaning(file: &str, column: &str) -> &'static str {
    match (file, column) {
        (_, "t") => "data time, s",
        (_, "t_arrival") => "monotonic time of arrival at the driver, s",
        (_, "sequence") => "counts the sender's messages; a gap is a loss",
        (_, "wx") => "angular rate about body x (forward), rad/s",
        (_, "wy") => "angular rate about body y (left), rad/s",
        (_, "wz") => "angular rate about body z (up), rad/s",
        (_, "fx") => "specific force along body x (forward), m/s^2",
        (_, "fy") => "specific force along body y (left), m/s^2",
        (_, "fz") => "specific force along body z (up), m/s^2",
        (_, "buoy") => "number of the buoy",
        (_, "range") => "slant range from the transducer to the buoy, m",
        (_, "in_epoch") => "ranges of this interrogation; 0: not known",
        (_, "moored") => "1: the position holds for ever; 0: it ages",
        (_, "lat") => "latitude, deg",
        (_, "lon") => "longitude, deg",
        (_, "h") => "ellipsoidal height, m; no key: not reported",
        (_, "se") => "1-sigma east, m; no key: not reported",
        (_, "sn") => "1-sigma north, m; no key: not reported",
        (_, "su") => "1-sigma up, m; no key: not reported",
        (_, "vx") => "velocity over ground along the instrument's x, m/s",
        (_, "vy") => "velocity over ground along the instrument's y, m/s",
        (_, "vz") => "velocity over ground along the instrument's z, m/s",
        (_, "heading") => "heading of body x, clockwise from north, before declination, deg",
        (_, "depth") => "depth of the pressure port below the mean surface, positive down, m",
        (_, "qw") => "body to ENU, Hamilton, w",
        (_, "qx") => "body to ENU, Hamilton, x",
        (_, "qy") => "body to ENU, Hamilton, y",
        (_, "qz") => "body to ENU, Hamilton, z",
        (_, "ve") => "velocity east, m/s",
        (_, "vn") => "velocity north, m/s",
        (_, "vu") => "velocity up, m/s",
        _ => "",
    }
}

/// Of a reading: the columns of its file.
pub(crate) fn row<R: LogRow>(title: &str) -> String {
    let property = |column: &&str| {
        let whole = ["sequence", "buoy", "in_epoch", "moored"].contains(column);
        let kind = if whole { "integer" } else { "number" };
        format!(r#""{column}":{{"type":"{kind}","description":"{}"}}"#, meaning(R::FILE, column))
    };
    let properties: Vec<String> = R::COLUMNS.iter().chain(R::RECORDED).map(property).collect();
    format!(r#"{{"title":"{title}","type":"object","properties":{{{}}}}}"#, properties.join(","))
}

macro_rules! time {
    () => {
        r#"{"type":"object","title":"time","properties":{"sec":{"type":"integer","minimum":0},"nsec":{"type":"integer","minimum":0,"maximum":999999999}}}"#
    };
}
macro_rules! duration {
    () => {
        r#"{"type":"object","title":"duration","properties":{"sec":{"type":"integer"},"nsec":{"type":"integer","minimum":0,"maximum":999999999}}}"#
    };
}
macro_rules! vector3 {
    ($title:literal) => {
        concat!(
            r#"{"title":"foxglove."#,
            $title,
            r#"","type":"object","properties":{"x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"}}}"#
        )
    };
}
macro_rules! quaternion {
    () => {
        r#"{"title":"foxglove.Quaternion","type":"object","properties":{"x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"},"w":{"type":"number"}}}"#
    };
}
macro_rules! pose {
    () => {
        concat!(
            r#"{"title":"foxglove.Pose","type":"object","properties":{"position":"#,
            vector3!("Vector3"),
            r#","orientation":"#,
            quaternion!(),
            "}}"
        )
    };
}
macro_rules! color {
    () => {
        r#"{"title":"foxglove.Color","type":"object","properties":{"r":{"type":"number"},"g":{"type":"number"},"b":{"type":"number"},"a":{"type":"number"}}}"#
    };
}

pub(crate) const POSE_IN_FRAME: &str = concat!(
    r#"{"title":"foxglove.PoseInFrame","type":"object","properties":{"timestamp":"#,
    time!(),
    r#","frame_id":{"type":"string"},"pose":"#,
    pose!(),
    "}}"
);

pub(crate) const FRAME_TRANSFORMS: &str = concat!(
    r#"{"title":"foxglove.FrameTransforms","type":"object","properties":{"transforms":{"type":"array","items":{"title":"foxglove.FrameTransform","type":"object","properties":{"timestamp":"#,
    time!(),
    r#","parent_frame_id":{"type":"string"},"child_frame_id":{"type":"string"},"translation":"#,
    vector3!("Vector3"),
    r#","rotation":"#,
    quaternion!(),
    "}}}}}"
);

pub(crate) const LOCATION_FIX: &str = concat!(
    r#"{"title":"foxglove.LocationFix","type":"object","properties":{"timestamp":"#,
    time!(),
    r#","frame_id":{"type":"string"},"latitude":{"type":"number","description":"deg"},"longitude":{"type":"number","description":"deg"},"altitude":{"type":"number","description":"m above the ellipsoid"},"position_covariance":{"type":"array","items":{"type":"number"},"minItems":9,"maxItems":9,"description":"ENU, m^2, row by row"},"position_covariance_type":{"type":"integer","description":"0 unknown, 1 approximated, 2 diagonal, 3 known"}}}"#
);

pub(crate) const SCENE_UPDATE: &str = concat!(
    r#"{"title":"foxglove.SceneUpdate","type":"object","properties":{"deletions":{"type":"array","items":{"title":"foxglove.SceneEntityDeletion","type":"object","properties":{"timestamp":"#,
    time!(),
    r#","type":{"type":"integer"},"id":{"type":"string"}}}},"entities":{"type":"array","items":{"title":"foxglove.SceneEntity","type":"object","properties":{"timestamp":"#,
    time!(),
    r#","frame_id":{"type":"string"},"id":{"type":"string"},"lifetime":"#,
    duration!(),
    r#","frame_locked":{"type":"boolean"},"metadata":{"type":"array","items":{"title":"foxglove.KeyValuePair","type":"object","properties":{"key":{"type":"string"},"value":{"type":"string"}}}},"spheres":{"type":"array","items":{"title":"foxglove.SpherePrimitive","type":"object","properties":{"pose":"#,
    pose!(),
    r#","size":"#,
    vector3!("Vector3"),
    r#","color":"#,
    color!(),
    r#"}}},"lines":{"type":"array","items":{"title":"foxglove.LinePrimitive","type":"object","properties":{"type":{"type":"integer","description":"0 strip, 1 loop, 2 list"},"pose":"#,
    pose!(),
    r#","thickness":{"type":"number"},"scale_invariant":{"type":"boolean"},"points":{"type":"array","items":"#,
    vector3!("Point3"),
    r#"},"color":"#,
    color!(),
    r#","colors":{"type":"array","items":"#,
    color!(),
    r#"},"indices":{"type":"array","items":{"type":"integer"}}}}},"texts":{"type":"array","items":{"title":"foxglove.TextPrimitive","type":"object","properties":{"pose":"#,
    pose!(),
    r#","billboard":{"type":"boolean"},"font_size":{"type":"number"},"scale_invariant":{"type":"boolean"},"color":"#,
    color!(),
    r#","text":{"type":"string"}}}}}}}}}"#
);

pub(crate) const ESTIMATE: &str = r#"{"title":"ilns.NavEstimate","type":"object","properties":{
"t":{"type":"number","description":"data time, s"},
"mode":{"type":"string","description":"INITIALISING, OK, DEGRADED, DEAD_RECKONING or INVALID"},
"solution":{"type":"integer","description":"number of the solution that it stands on"},
"e":{"type":"number","description":"IMU position east of the origin, m"},
"n":{"type":"number","description":"IMU position north of the origin, m"},
"u":{"type":"number","description":"IMU position above the origin, m"},
"qw":{"type":"number","description":"body to ENU, Hamilton, w"},
"qx":{"type":"number","description":"body to ENU, Hamilton, x"},
"qy":{"type":"number","description":"body to ENU, Hamilton, y"},
"qz":{"type":"number","description":"body to ENU, Hamilton, z"},
"ve":{"type":"number","description":"velocity east, m/s"},
"vn":{"type":"number","description":"velocity north, m/s"},
"vu":{"type":"number","description":"velocity up, m/s"},
"bax":{"type":"number","description":"accelerometer bias, body x, m/s^2"},
"bay":{"type":"number","description":"accelerometer bias, body y, m/s^2"},
"baz":{"type":"number","description":"accelerometer bias, body z, m/s^2"},
"bgx":{"type":"number","description":"gyroscope bias, body x, rad/s"},
"bgy":{"type":"number","description":"gyroscope bias, body y, rad/s"},
"bgz":{"type":"number","description":"gyroscope bias, body z, rad/s"},
"se":{"type":"number","description":"1-sigma east, m"},
"sn":{"type":"number","description":"1-sigma north, m"},
"su":{"type":"number","description":"1-sigma up, m"},
"sroll":{"type":"number","description":"1-sigma about body x, rad"},
"spitch":{"type":"number","description":"1-sigma about body y, rad"},
"syaw":{"type":"number","description":"1-sigma about the up axis, rad"},
"lat":{"type":"number","description":"latitude, deg"},
"lon":{"type":"number","description":"longitude, deg"},
"h":{"type":"number","description":"ellipsoidal height, m"}}}"#;

pub(crate) const FRAME_ORIGIN: &str = r#"{"title":"ilns.FrameOrigin","type":"object","properties":{
"lat":{"type":"number","description":"latitude of the ENU origin, deg"},
"lon":{"type":"number","description":"longitude of the ENU origin, deg"},
"h":{"type":"number","description":"ellipsoidal height of the ENU origin, m"}}}"#;

pub(crate) const KEYFRAME_REPORT: &str = r#"{"title":"ilns.KeyframeReport","type":"object","properties":{
"t_keyframe":{"type":"number","description":"data time of the keyframe, s"},
"solution":{"type":"integer","description":"number of the solution"},
"cost_before":{"type":"number","description":"half the weighted sum of squares before the solve"},
"cost_after":{"type":"number","description":"half the weighted sum of squares after the solve"},
"iterations":{"type":"integer"},
"keyframes":{"type":"integer","description":"keyframes in the window"},
"factors_left_out":{"type":"integer","description":"factors that the report had no room for"},
"factors":{"type":"array","items":{"type":"object","properties":{
"t":{"type":"number","description":"data time of the reading, s"},
"sensor":{"type":"string"},
"buoy":{"type":"integer"},
"refused":{"type":"string","description":"reason; no key: the reading was used"},
"nis":{"type":"number","description":"squared normalised innovation"},
"weight":{"type":"number","description":"robust weight"},
"whitened":{"type":"array","items":{"type":"number"},"description":"innovation in sigmas, predicted minus measured"},
"gate":{"type":"array","items":{"type":"number"},"description":"what the gate lets through: of the innovation in sigmas for a range, else of the root of nis; no key: no gate"}}}}}}"#;

pub(crate) const HEARTBEAT: &str = r#"{"title":"ilns.Heartbeat","type":"object","properties":{
"process":{"type":"string"},
"state":{"type":"string"},
"pid":{"type":"integer"},
"restarts":{"type":"integer"},
"cpu_s":{"type":"number","description":"user plus system time since the start, s"},
"resident_bytes":{"type":"integer"},
"handled":{"type":"integer"},
"dropped":{"type":"integer"},
"hop_in_p50_us":{"type":"number","description":"from publication to receipt on the main input, median, us"},
"hop_in_p99_us":{"type":"number"},
"hop_in_max_us":{"type":"number"},
"end_to_end_p50_us":{"type":"number","description":"from arrival of the origin to publication, median, us"},
"end_to_end_p99_us":{"type":"number"},
"end_to_end_max_us":{"type":"number"},
"work_p50_us":{"type":"number","description":"main piece of work, median, us"},
"work_p99_us":{"type":"number"},
"work_max_us":{"type":"number"}}}"#;

pub(crate) const RECORDER_STATUS: &str = r#"{"title":"ilns.RecorderStatus","type":"object","properties":{
"dropped":{"type":"integer","description":"messages for this recording that found its queue full, since the recorder's start"},
"lost":{"type":"integer","description":"messages that did not reach the recorder, since its start"}}}"#;
