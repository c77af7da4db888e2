//! Which channel of the file holds what, under which schema.

use shared_types::{BuoyFix, DvlVelocity, GnssFix, ImuSample, LblRange, McpHeading, PsDepth, Sensor, Truth};

use super::schemas;
use crate::rows::LogRow;

/// A channel of the file; its number there is its place in [`Topic::ALL`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Topic {
    /// Raw readings of a sensor: complete.
    Sensor(Sensor),
    /// The truth of a scenario.
    Truth,
    /// The published estimate, thinned.
    Estimate,
    /// The same as a pose for 3D views.
    Pose,
    /// The same as the transform from `map` to `base_link`.
    Transform,
    /// The same as a place on a chart.
    Location,
    /// Satellite fixes as places on a chart.
    GnssLocation,
    /// Buoys and the 95 % ellipse.
    Scene,
    /// Origin of the ENU frame.
    FrameOrigin,
    /// What each keyframe held.
    Diagnostics,
    /// What each process says of itself.
    Health,
    /// What the recording says of itself.
    Recorder,
}

impl Topic {
    /// All, in the order of their numbers.
    pub(crate) const ALL: [Topic; 18] = [
        Topic::Sensor(Sensor::Imu),
        Topic::Sensor(Sensor::Lbl),
        Topic::Sensor(Sensor::Gnss),
        Topic::Sensor(Sensor::Dvl),
        Topic::Sensor(Sensor::Mcp),
        Topic::Sensor(Sensor::Ps),
        Topic::Sensor(Sensor::Buoys),
        Topic::Truth,
        Topic::Estimate,
        Topic::Pose,
        Topic::Transform,
        Topic::Location,
        Topic::GnssLocation,
        Topic::Scene,
        Topic::FrameOrigin,
        Topic::Diagnostics,
        Topic::Health,
        Topic::Recorder,
    ];

    /// What a channel of a file holds; `None` for one of another program.
    pub(crate) fn of(channel: &::mcap::records::Channel) -> Option<Topic> {
        let is_ours = channel.message_encoding == "json";
        Topic::ALL.into_iter().find(|topic| is_ours && topic.name() == channel.topic)
    }

    /// Its place in [`Topic::ALL`].
    pub(crate) fn index(self) -> usize {
        match self {
            Topic::Sensor(sensor) => sensor.index(),
            Topic::Truth => 7,
            Topic::Estimate => 8,
            Topic::Pose => 9,
            Topic::Transform => 10,
            Topic::Location => 11,
            Topic::GnssLocation => 12,
            Topic::Scene => 13,
            Topic::FrameOrigin => 14,
            Topic::Diagnostics => 15,
            Topic::Health => 16,
            Topic::Recorder => 17,
        }
    }

    /// Its name: the house's channel where there is one.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Topic::Sensor(Sensor::Imu) => "/sensor/imu",
            Topic::Sensor(Sensor::Lbl) => "/sensor/lbl",
            Topic::Sensor(Sensor::Gnss) => "/sensor/gnss",
            Topic::Sensor(Sensor::Dvl) => "/sensor/dvl",
            Topic::Sensor(Sensor::Mcp) => "/sensor/mcp",
            Topic::Sensor(Sensor::Ps) => "/sensor/ps",
            Topic::Sensor(Sensor::Buoys) => "/sensor/buoys",
            Topic::Truth => "/sim/truth",
            Topic::Estimate => "/nav/estimate",
            Topic::Pose => "/pose",
            Topic::Transform => "/tf",
            Topic::Location => "/fix",
            Topic::GnssLocation => "/gnss/fix",
            Topic::Scene => "/scene",
            Topic::FrameOrigin => "/nav/frame_origin",
            Topic::Diagnostics => "/nav/diagnostics",
            Topic::Health => "/health",
            Topic::Recorder => "/recorder/status",
        }
    }

    /// Name and JSON text of its schema.
    pub(crate) fn schema(self) -> (&'static str, String) {
        match self {
            Topic::Sensor(Sensor::Imu) => ("ilns.ImuSample", schemas::row::<ImuSample>("ilns.ImuSample")),
            Topic::Sensor(Sensor::Lbl) => ("ilns.LblRange", schemas::row::<LblRange>("ilns.LblRange")),
            Topic::Sensor(Sensor::Gnss) => ("ilns.GnssFix", schemas::row::<GnssFix>("ilns.GnssFix")),
            Topic::Sensor(Sensor::Dvl) => ("ilns.DvlVelocity", schemas::row::<DvlVelocity>("ilns.DvlVelocity")),
            Topic::Sensor(Sensor::Mcp) => ("ilns.McpHeading", schemas::row::<McpHeading>("ilns.McpHeading")),
            Topic::Sensor(Sensor::Ps) => ("ilns.PsDepth", schemas::row::<PsDepth>("ilns.PsDepth")),
            Topic::Sensor(Sensor::Buoys) => ("ilns.BuoyFix", schemas::row::<BuoyFix>("ilns.BuoyFix")),
            Topic::Truth => ("ilns.Truth", schemas::row::<Truth>("ilns.Truth")),
            Topic::Estimate => ("ilns.NavEstimate", schemas::ESTIMATE.to_owned()),
            Topic::Pose => ("foxglove.PoseInFrame", schemas::POSE_IN_FRAME.to_owned()),
            Topic::Transform => ("foxglove.FrameTransforms", schemas::FRAME_TRANSFORMS.to_owned()),
            Topic::Location | Topic::GnssLocation => ("foxglove.LocationFix", schemas::LOCATION_FIX.to_owned()),
            Topic::Scene => ("foxglove.SceneUpdate", schemas::SCENE_UPDATE.to_owned()),
            Topic::FrameOrigin => ("ilns.FrameOrigin", schemas::FRAME_ORIGIN.to_owned()),
            Topic::Diagnostics => ("ilns.KeyframeReport", schemas::KEYFRAME_REPORT.to_owned()),
            Topic::Health => ("ilns.Heartbeat", schemas::HEARTBEAT.to_owned()),
            Topic::Recorder => ("ilns.RecorderStatus", schemas::RECORDER_STATUS.to_owned()),
        }
    }

    /// The log directory's file of it, with its columns: those of the format, then those of a recording.
    pub(crate) fn log_file(self) -> Option<LogFile> {
        let file = match self {
            Topic::Sensor(Sensor::Imu) => LogFile::of::<ImuSample>(),
            Topic::Sensor(Sensor::Lbl) => LogFile::of::<LblRange>(),
            Topic::Sensor(Sensor::Gnss) => LogFile::of::<GnssFix>(),
            Topic::Sensor(Sensor::Dvl) => LogFile::of::<DvlVelocity>(),
            Topic::Sensor(Sensor::Mcp) => LogFile::of::<McpHeading>(),
            Topic::Sensor(Sensor::Ps) => LogFile::of::<PsDepth>(),
            Topic::Sensor(Sensor::Buoys) => LogFile::of::<BuoyFix>(),
            Topic::Truth => LogFile::of::<Truth>(),
            _ => return None,
        };
        Some(file)
    }
}

/// A file of the log directory.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LogFile {
    pub(crate) name: &'static str,
    columns: &'static [&'static str],
    recorded: &'static [&'static str],
}

impl LogFile {
    fn of<R: LogRow>() -> LogFile {
        LogFile { name: R::FILE, columns: R::COLUMNS, recorded: R::RECORDED }
    }

    pub(crate) fn columns(&self) -> impl Iterator<Item = &'static str> {
        self.columns.iter().chain(self.recorded).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_topic_stands_in_its_place_with_a_schema_that_is_json() {
        for (index, topic) in Topic::ALL.into_iter().enumerate() {
            assert_eq!(topic.index(), index, "{}", topic.name());
            let (name, text) = topic.schema();
            let schema: serde_json::Value = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!(schema["title"], name);
            assert_eq!(schema["type"], "object");
        }
    }
}
