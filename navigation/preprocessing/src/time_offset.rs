//! To which keyframe is a reading tied, and with which offset?
//!
//! ```text
//! T = t_valid − t_keyframe      T > 0: reached by forward preintegration, T < 0: backward          (FBPF, §3.1)
//! ```
//!
//! Which neighbour is nearer is known only when the next keyframe comes, so readings wait here until then. They come out
//! in order of time, the ranges of an epoch behind the other readings of their instant, and the keyframe closes the
//! batch like a bracket:
//!
//! ```text
//! … readings of (t_k−1, t_k], tied to k−1 or k …   Keyframe k        (late readings, tied further back, stand in front)
//! ```
//!
//! A filter needs none of it ([`AnchorMethod::AtOnce`]): its readings go out as soon as they are taken up, tied to their own time,
//! and the bracket says when a solution is wanted.
//!
//! FPF and the joint form tie to the earlier neighbour always. PF pretends that the reading was taken at its keyframe: its `t_valid`
//! becomes `t_keyframe`.

use shared_types::{AnchorMethod, KeyframeCause, Measurement, Reading, RejectReason, Sensor, Time};

use crate::keyframe_times::KeyframeTimes;

/// Readings that one interval holds: 5 s (the longest `keyframes.max_age`) of all sensors at 100 Hz, and a minute of IMU
/// silence at usual rates.
const CAPACITY: usize = 4096;

/// Readings that wait for their keyframe.
#[derive(Clone, Debug)]
pub(crate) struct TimeOffsets {
    method: AnchorMethod,
    held: Vec<Measurement>,
    /// Something went out at once that no keyframe has closed yet.
    is_unclosed: bool,
}

impl TimeOffsets {
    pub(crate) fn new(method: AnchorMethod) -> TimeOffsets {
        TimeOffsets { method, held: Vec::with_capacity(CAPACITY), is_unclosed: false }
    }

    /// Takes a reading in, to be tied when the next keyframe is known.
    ///
    /// # Errors
    /// [`RejectReason::TooMany`] when the interval is full.
    pub(crate) fn hold(&mut self, measurement: Measurement) -> Result<(), RejectReason> {
        if self.held.len() == CAPACITY {
            return Err(RejectReason::TooMany);
        }
        // Already in order but for late readings, which are few and walk in from the back. Equals stay as they came.
        let key = order(&measurement);
        let slot = self.held.iter().rposition(|earlier| order(earlier) <= key).map_or(0, |index| index + 1);
        self.held.insert(slot, measurement);
        Ok(())
    }

    /// Lets everything go that need not wait for a keyframe.
    pub(crate) fn let_go_at_once(&mut self, emit: &mut impl FnMut(Measurement)) {
        if self.method == AnchorMethod::AtOnce {
            self.is_unclosed |= !self.held.is_empty();
            self.held.drain(..).for_each(emit);
        }
    }

    /// A keyframe was closed (it is the newest of `times`): lets its batch go, and the keyframe behind it. Readings older
    /// than the window go to `reject`.
    pub(crate) fn on_keyframe(
        &mut self,
        times: &KeyframeTimes,
        t_keyframe: Time,
        cause: KeyframeCause,
        emit: &mut impl FnMut(Measurement),
        mut reject: impl FnMut(&Measurement, RejectReason),
    ) {
        self.is_unclosed = false;
        for mut measurement in self.held.drain(..) {
            let Some(anchor) = times.anchor(measurement.t_valid()) else {
                reject(&measurement, RejectReason::OlderThanWindow);
                continue;
            };
            measurement.t_keyframe = anchor.0;
            if self.method == AnchorMethod::Pf {
                measurement.header.t_valid = anchor.0;
            }
            emit(measurement);
        }
        emit(Measurement::new(t_keyframe, t_keyframe, &Reading::Keyframe { cause }));
    }

    /// Gives up what still waits.
    pub(crate) fn abandon(&mut self, mut reject: impl FnMut(&Measurement, RejectReason)) {
        for measurement in self.held.drain(..) {
            reject(&measurement, RejectReason::NoImu);
        }
    }

    /// Whether nothing waits for a keyframe.
    pub(crate) fn is_empty(&self) -> bool {
        self.held.is_empty() && !self.is_unclosed
    }

    /// How many of a sensor wait.
    pub(crate) fn held(&self, sensor: Sensor) -> usize {
        self.held.iter().filter(|measurement| measurement.sensor() == Some(sensor)).count()
    }
}

fn order(measurement: &Measurement) -> (Time, bool) {
    (measurement.t_valid(), measurement.sensor() == Some(Sensor::Lbl))
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]
    use super::*;
    use shared_types::Navigator;

    fn at(t: f64) -> Time {
        Time::from_seconds(t)
    }

    fn depth(t: f64) -> Measurement {
        Measurement::new(at(t), at(t), &Reading::Ps { depth: 1.0 })
    }

    fn range(t: f64) -> Measurement {
        let reading =
            Reading::Lbl { buoy: 1, epoch: 1, range: 5.0, buoy_enu: [0.0; 3], buoy_sigma: 0.0, is_moored: true };
        Measurement::new(at(t), at(t), &reading)
    }

    /// Holds the measurements, closes keyframes at 10 and 11 s, and returns (t_valid, t_keyframe, kind) in seconds.
    fn batch(method: AnchorMethod, measurements: &[Measurement]) -> Vec<(f64, f64, u32)> {
        let mut config = Navigator::default().keyframes;
        config.anchor = method;
        let mut times = KeyframeTimes::new(&config, 20);
        let mut offsets = TimeOffsets::new(method);
        times.on_start(at(10.0));
        times.close(at(10.0));
        for &measurement in measurements {
            offsets.hold(measurement).unwrap();
        }
        times.close(at(11.0));
        let mut out = Vec::new();
        offsets.on_keyframe(
            &times,
            at(11.0),
            KeyframeCause::Lbl,
            &mut |m| out.push((m.t_valid().as_seconds(), m.t_keyframe().as_seconds(), m.kind)),
            |m, reason| panic!("{m:?} {reason}"),
        );
        assert!(offsets.is_empty());
        out
    }

    const PS: u32 = Sensor::Ps as u32;
    const LBL: u32 = Sensor::Lbl as u32;
    const BRACKET: (f64, f64, u32) = (11.0, 11.0, Measurement::KEYFRAME);

    #[test]
    fn readings_hold_to_the_nearer_keyframe_and_keep_their_own_time() {
        let out = batch(AnchorMethod::Fbpf, &[depth(10.2), depth(10.7)]);
        assert_eq!(out, [(10.2, 10.0, PS), (10.7, 11.0, PS), BRACKET]);
    }

    #[test]
    fn forward_only_holds_to_the_keyframe_before() {
        let out = batch(AnchorMethod::Fpf, &[depth(10.2), depth(10.7)]);
        assert_eq!(out, [(10.2, 10.0, PS), (10.7, 10.0, PS), BRACKET]);
    }

    #[test]
    fn position_focused_pretends_that_the_reading_was_taken_at_its_keyframe() {
        let out = batch(AnchorMethod::Pf, &[depth(10.2), depth(10.7)]);
        assert_eq!(out, [(10.0, 10.0, PS), (11.0, 11.0, PS), BRACKET]);
    }

    #[test]
    fn a_filter_gets_its_readings_at_once_and_tied_to_their_own_time() {
        let mut offsets = TimeOffsets::new(AnchorMethod::AtOnce);
        offsets.hold(depth(10.7)).unwrap();
        let mut out = Vec::new();
        offsets.let_go_at_once(&mut |m| out.push((m.t_valid(), m.t_keyframe())));
        assert_eq!(out, [(at(10.7), at(10.7))]);
        assert!(offsets.held.is_empty() && !offsets.is_empty(), "the bracket is still to come");
        let mut offsets = TimeOffsets::new(AnchorMethod::Fbpf);
        offsets.hold(depth(10.7)).unwrap();
        offsets.let_go_at_once(&mut |m| panic!("{m:?} goes out with its keyframe"));
    }

    #[test]
    fn a_late_reading_walks_to_its_place_and_ranges_stand_behind_their_instant() {
        let out = batch(AnchorMethod::Fbpf, &[range(10.5), depth(10.7), depth(10.5), range(10.2)]);
        let times_and_kinds: Vec<_> = out.iter().map(|&(t, _, kind)| (t, kind)).collect();
        assert_eq!(times_and_kinds, [(10.2, LBL), (10.5, PS), (10.5, LBL), (10.7, PS), (11.0, Measurement::KEYFRAME)]);
    }

    #[test]
    fn a_full_interval_refuses_more() {
        let mut offsets = TimeOffsets::new(AnchorMethod::Fbpf);
        for _ in 0..CAPACITY {
            offsets.hold(depth(1.0)).unwrap();
        }
        assert_eq!(offsets.hold(depth(1.0)), Err(RejectReason::TooMany));
    }
}
