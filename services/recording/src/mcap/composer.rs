//! What is published, as the messages that views of MCAP know: for a file, or for somebody who looks on live.

use std::collections::BTreeMap;

use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{BuoyFix, Duration, GnssFix, Heartbeat, KeyframeReport, NavEstimate, RawReading, Time, Truth};

use super::thinning::EstimateThinning;
use super::topics::Topic;
use super::{messages, scene};
use crate::error::LogError;
use crate::rows::LogRow;

/// Between two scenes.
const SCENE_PERIOD: Duration = Duration(1_000_000_000);
/// How an estimate becomes the text of a message.
type Write = fn(&mut Vec<u8>, &NavEstimate);

/// A channel of messages: JSON under a JSON schema.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MessageChannel {
    /// `/tf`, `/nav/estimate`, ...
    pub topic: &'static str,
    /// `foxglove.FrameTransforms`, `ilns.NavEstimate`, ...
    pub schema_name: &'static str,
    /// JSON schema.
    pub schema: String,
}

/// Every channel, in the order of the numbers that [`MessageSink::put`] gets.
pub fn message_channels() -> Vec<MessageChannel> {
    let channel = |topic: Topic| {
        let (schema_name, schema) = topic.schema();
        MessageChannel { topic: topic.name(), schema_name, schema }
    };
    Topic::ALL.map(channel).to_vec()
}

/// Where composed messages go.
pub trait MessageSink {
    /// Takes the message `text` of the data time `t_ns` on the channel of that number.
    ///
    /// # Errors
    /// Those of a file.
    fn put(&mut self, channel: usize, t_ns: i64, text: &[u8]) -> Result<(), LogError>;
}

/// Composes messages. Errors of its methods are those of the sink.
#[derive(Debug, Default)]
pub struct Composer {
    frame: Option<LocalFrame>,
    origin: Option<[f64; 3]>,
    buoys: BTreeMap<u32, BuoyFix>,
    t_newest: i64,
    thinning: EstimateThinning,
    t_scene: Option<Time>,
    text: Vec<u8>,
    scratch: Vec<u8>,
}

impl Composer {
    /// Nothing has been published yet.
    pub fn new() -> Composer {
        Composer::default()
    }

    /// Begins anew with what holds for the whole run: the origin, which is put, and the moored buoys, which views draw.
    pub(crate) fn go_on(&self, sink: &mut impl MessageSink) -> Result<Composer, LogError> {
        let mut next = Composer { t_newest: self.t_newest, buoys: self.buoys.clone(), ..Composer::default() };
        if let Some(origin) = self.origin {
            next.origin(origin, sink)?;
        }
        Ok(next)
    }

    /// Data time of the newest reading or estimate.
    pub fn t_newest(&self) -> Time {
        Time(self.t_newest)
    }

    fn put(&mut self, topic: Topic, t_ns: i64, sink: &mut impl MessageSink) -> Result<(), LogError> {
        sink.put(topic.index(), t_ns, &self.text)
    }

    fn row<R: LogRow>(&mut self, topic: Topic, row: &R, sink: &mut impl MessageSink) -> Result<(), LogError> {
        self.text.clear();
        messages::row(&mut self.text, &mut self.scratch, row);
        let t = row.header().t_valid;
        self.t_newest = self.t_newest.max(t);
        self.put(topic, t, sink)
    }

    /// A reading; a satellite fix is a place on a chart, too.
    ///
    /// # Errors
    /// The sink's.
    pub fn reading(&mut self, reading: &RawReading, sink: &mut impl MessageSink) -> Result<(), LogError> {
        let topic = Topic::Sensor(reading.sensor());
        match reading {
            RawReading::Imu(sample) => self.row(topic, sample, sink),
            RawReading::Lbl(range) => self.row(topic, range, sink),
            RawReading::Dvl(velocity) => self.row(topic, velocity, sink),
            RawReading::Mcp(heading) => self.row(topic, heading, sink),
            RawReading::Ps(depth) => self.row(topic, depth, sink),
            RawReading::Buoy(fix) => {
                self.buoys.insert(fix.buoy, *fix);
                self.row(topic, fix, sink)
            }
            RawReading::Gnss(fix) => {
                self.row(topic, fix, sink)?;
                self.gnss_location(fix, sink)
            }
        }
    }

    fn gnss_location(&mut self, fix: &GnssFix, sink: &mut impl MessageSink) -> Result<(), LogError> {
        if !(fix.lat_deg.is_finite() && fix.lon_deg.is_finite()) {
            return Ok(());
        }
        self.text.clear();
        messages::gnss_location(&mut self.text, fix);
        self.put(Topic::GnssLocation, fix.header.t_valid, sink)
    }

    /// A row of the truth.
    ///
    /// # Errors
    /// The sink's.
    pub fn truth(&mut self, truth: &Truth, sink: &mut impl MessageSink) -> Result<(), LogError> {
        self.row(Topic::Truth, truth, sink)
    }

    /// The frame's origin: latitude, longitude in degrees, ellipsoidal height in m. Only the first counts; it never moves.
    ///
    /// # Errors
    /// The sink's.
    pub fn origin(&mut self, origin: [f64; 3], sink: &mut impl MessageSink) -> Result<(), LogError> {
        if self.frame.is_some() {
            return Ok(());
        }
        let [lat_deg, lon_deg, height] = origin;
        self.frame = Some(LocalFrame::new(Geodetic::from_degrees(lat_deg, lon_deg, height)));
        self.origin = Some(origin);
        self.repeat_origin(sink)
    }

    /// The origin again, once it is known, for those who come late.
    ///
    /// # Errors
    /// The sink's.
    pub fn repeat_origin(&mut self, sink: &mut impl MessageSink) -> Result<(), LogError> {
        let Some(origin) = self.origin else { return Ok(()) };
        self.text.clear();
        messages::frame_origin(&mut self.text, origin);
        self.put(Topic::FrameOrigin, self.t_newest, sink)
    }

    /// An estimate, if [`EstimateThinning`] says so, as pose, transform and place; once a second with the scene.
    ///
    /// # Errors
    /// The sink's.
    pub fn estimate(&mut self, estimate: &NavEstimate, sink: &mut impl MessageSink) -> Result<(), LogError> {
        if !self.thinning.wants(estimate) {
            return Ok(());
        }
        let t = Time(estimate.header.t_valid);
        self.t_newest = self.t_newest.max(t.0);
        let writes: [(Topic, Write); 4] = [
            (Topic::Estimate, messages::estimate),
            (Topic::Pose, messages::pose_in_frame),
            (Topic::Transform, messages::transforms),
            (Topic::Location, messages::location),
        ];
        for (topic, write) in writes {
            self.text.clear();
            write(&mut self.text, estimate);
            self.put(topic, t.0, sink)?;
        }
        let is_scene_due = self.t_scene.is_none_or(|last| t < last || t - last >= SCENE_PERIOD);
        if let Some(frame) = self.frame.as_ref().filter(|_| is_scene_due) {
            self.t_scene = Some(t);
            self.text.clear();
            scene::update(&mut self.text, estimate, frame, &self.buoys);
            self.put(Topic::Scene, t.0, sink)?;
        }
        Ok(())
    }

    /// What a keyframe held.
    ///
    /// # Errors
    /// The sink's.
    pub fn report(&mut self, report: &KeyframeReport, sink: &mut impl MessageSink) -> Result<(), LogError> {
        self.text.clear();
        messages::keyframe_report(&mut self.text, report);
        self.put(Topic::Diagnostics, report.t_keyframe, sink)
    }

    /// What a process says of itself, at the data time of the newest reading: a process may know no other.
    ///
    /// # Errors
    /// The sink's.
    pub fn heartbeat(&mut self, beat: &Heartbeat, sink: &mut impl MessageSink) -> Result<(), LogError> {
        self.text.clear();
        messages::heartbeat(&mut self.text, beat);
        self.put(Topic::Health, self.t_newest, sink)
    }
}
