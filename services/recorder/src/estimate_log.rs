//! Live estimates on their way to `estimate.csv`, in order of data time.
//!
//! While the IMU is silent the propagator says so with estimates ahead of any sample. When the silence ends, the samples of
//! the time between may still come, and their estimates go back in time. So estimates without a sample wait until one with
//! a later sample comes, or until there are too many of them. Those behind the very last sample are not written: a run ends
//! with its IMU, and not with the seconds in which it is taken down.

use std::collections::VecDeque;
use std::path::Path;

use ilns_recording::{EstimateWriter, LogError};
use shared_types::{Mode, NavEstimate, Time};

/// Two seconds of silence at 20 estimates a second. By then it is a fault and not an end.
const WAITING_MAX: usize = 40;

/// Writes each estimate once, in order of time.
#[derive(Debug)]
pub(crate) struct EstimateLog {
    writer: EstimateWriter,
    waiting: VecDeque<NavEstimate>,
    t_last: Option<Time>,
    written: Written,
}

/// What stands in the file, and what does not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Written {
    /// Data time of the first and the last row.
    pub(crate) span: Option<(Time, Time)>,
    /// Rows per mode.
    pub(crate) modes: [u64; Mode::ALL.len()],
    /// Left out: not later than the row before.
    pub(crate) out_of_order: u64,
    /// Left out: a number that is none.
    pub(crate) not_finite: u64,
}

impl EstimateLog {
    pub(crate) fn create(out: &Path) -> Result<EstimateLog, LogError> {
        Ok(EstimateLog {
            writer: EstimateWriter::create(out)?,
            waiting: VecDeque::with_capacity(WAITING_MAX + 1),
            t_last: None,
            written: Written::default(),
        })
    }

    /// Takes an estimate as it was published; shows each that is written, in order of time, to `see`.
    pub(crate) fn take(&mut self, estimate: &NavEstimate, see: &mut impl FnMut(&NavEstimate)) -> Result<(), LogError> {
        if is_without_sample(estimate) {
            self.waiting.push_back(*estimate);
            if self.waiting.len() > WAITING_MAX {
                return self.write_waiting(see);
            }
            return Ok(());
        }
        while self.waiting.front().is_some_and(|first| first.header.t_valid < estimate.header.t_valid) {
            self.write_waiting(see)?;
        }
        self.write(estimate, see)
    }

    fn write_waiting(&mut self, see: &mut impl FnMut(&NavEstimate)) -> Result<(), LogError> {
        match self.waiting.pop_front() {
            Some(first) => self.write(&first, see),
            None => Ok(()),
        }
    }

    fn write(&mut self, estimate: &NavEstimate, see: &mut impl FnMut(&NavEstimate)) -> Result<(), LogError> {
        let t = Time(estimate.header.t_valid);
        if self.t_last.is_some_and(|t_last| t <= t_last) {
            self.written.out_of_order += 1;
            return Ok(());
        }
        let rows_before = self.writer.rows();
        let taken = match self.writer.write(estimate) {
            Err(LogError::EstimateNotFinite { .. }) => {
                self.written.not_finite += 1;
                Ok(())
            }
            // A disk that refuses now gets the row later.
            other => other,
        };
        self.t_last = Some(t);
        // INITIALISING estimates are not written.
        if self.writer.rows() > rows_before {
            let first = self.written.span.map_or(t, |(first, _)| first);
            self.written.span = Some((first, t));
            self.written.modes[estimate.mode() as usize] += 1;
            see(estimate);
        }
        taken
    }

    pub(crate) fn flush(&mut self) -> Result<(), LogError> {
        self.writer.flush()
    }

    /// Completes both files and gives them their names.
    pub(crate) fn finish(self) -> Result<Written, LogError> {
        self.writer.finish()?;
        Ok(self.written)
    }
}

/// Only an estimate that answers to an IMU sample says when that arrived.
fn is_without_sample(estimate: &NavEstimate) -> bool {
    estimate.header.origin_t_arrival == 0 && estimate.mode() == Mode::Invalid
}

#[cfg(test)]
pub(crate) mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]
    use super::*;
    use shared_types::Header;

    /// At the origin, certain to a metre.
    pub(crate) fn estimate(t: f64, mode: Mode) -> NavEstimate {
        let unit_cov = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0];
        NavEstimate {
            header: Header { origin_t_arrival: 1, ..Header::at(Time::from_seconds(t)) },
            solution: 0,
            t_keyframe: 0,
            position_enu: [0.0; 3],
            velocity_enu: [0.0; 3],
            q_enu_body: [1.0, 0.0, 0.0, 0.0],
            accel_bias: [0.0; 3],
            gyro_bias: [0.0; 3],
            position_cov: unit_cov,
            velocity_cov: unit_cov,
            attitude_cov: unit_cov,
            sigma_rpy: [1.0; 3],
            lat_lon_h: [36.0, 127.0, 0.0],
            aiding_age: [f64::INFINITY; 5],
            mode: mode as u32,
            reserved: 0,
        }
    }

    fn without_sample(t: f64) -> NavEstimate {
        let held = estimate(t, Mode::Invalid);
        NavEstimate { header: Header::at(Time::from_seconds(t)), ..held }
    }

    /// The times and modes in the file that these estimates leave.
    fn rows(estimates: &[NavEstimate]) -> (Vec<(f64, u32)>, Written) {
        let folder = tempfile::tempdir().unwrap();
        let mut log = EstimateLog::create(folder.path()).unwrap();
        for estimate in estimates {
            log.take(estimate, &mut |_| {}).unwrap();
        }
        let written = log.finish().unwrap();
        let file = ilns_recording::read_estimates(folder.path().join("estimate.csv")).unwrap();
        let rows = file.map(|row| row.unwrap()).map(|row| (row.t.as_seconds(), row.mode.unwrap())).collect();
        (rows, written)
    }

    const OK: u32 = Mode::Ok as u32;
    const INVALID: u32 = Mode::Invalid as u32;

    #[test]
    fn estimates_of_samples_that_come_after_a_silence_go_back_to_their_place() {
        let ok = |t| estimate(t, Mode::Ok);
        let (rows, written) =
            rows(&[ok(1.0), without_sample(1.25), without_sample(1.5), ok(1.125), ok(1.375), ok(2.0)]);
        assert_eq!(rows, [(1.0, OK), (1.125, OK), (1.25, INVALID), (1.375, OK), (1.5, INVALID), (2.0, OK)]);
        assert_eq!(written.modes, [0, 4, 0, 0, 2]);
        assert_eq!(written.span, Some((Time::from_seconds(1.0), Time::from_seconds(2.0))));
    }

    #[test]
    fn a_run_ends_with_its_last_sample() {
        let (rows, _) = rows(&[estimate(1.0, Mode::Ok), without_sample(1.5), without_sample(2.0)]);
        assert_eq!(rows, [(1.0, OK)]);
    }

    #[test]
    fn a_silence_that_lasts_is_written() {
        let mut estimates = vec![estimate(1.0, Mode::Ok)];
        estimates.extend((1..=WAITING_MAX + 3).map(|step| without_sample(1.0 + step as f64 * 0.0625)));
        let (rows, _) = rows(&estimates);
        assert_eq!(rows, [(1.0, OK), (1.0625, INVALID), (1.125, INVALID), (1.1875, INVALID)]);
    }

    #[test]
    fn what_is_initialising_not_finite_or_out_of_order_is_left_out_and_counted() {
        let mut spoilt = estimate(2.0, Mode::Ok);
        spoilt.position_enu[0] = f64::NAN;
        let estimates = [
            estimate(0.5, Mode::Initialising),
            estimate(1.0, Mode::Ok),
            spoilt,
            estimate(1.5, Mode::Ok),
            estimate(3.0, Mode::Ok),
        ];
        let (rows, written) = rows(&estimates);
        assert_eq!(rows, [(1.0, OK), (3.0, OK)]);
        assert_eq!((written.not_finite, written.out_of_order), (1, 1));
    }
}
