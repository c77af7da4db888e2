//! Why a reading was not used. Every reading that does not reach the estimate is counted under one of these.

/// The reason; the number is its index in every table of counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u32)]
pub enum RejectReason {
    /// A number was NaN or infinite.
    NotFinite = 0,
    /// Outside what the instrument or the vehicle can do.
    OutOfRange = 1,
    /// The same reading came before.
    Duplicate = 2,
    /// Not later than its predecessor where order matters (IMU).
    BackwardsTime = 3,
    /// Older than the oldest keyframe of the window.
    OlderThanWindow = 4,
    /// Before the estimation starts.
    BeforeStart = 5,
    /// A range to a buoy whose position was never reported.
    UnknownBuoy = 6,
    /// A range to a buoy whose last position is too old.
    StaleBuoy = 7,
    /// A satellite fix while the vehicle is deep.
    WhileDeep = 8,
    /// A heading while the body x axis is near the vertical.
    NearVertical = 9,
    /// The innovation is improbable under its own covariance.
    Gated = 10,
    /// The sensor is switched off in the configuration.
    Disabled = 11,
    /// A malformed message: unknown kind, impossible count.
    Malformed = 12,
    /// No IMU data around the reading, so that no keyframe can be reached.
    NoImu = 13,
    /// More readings than an interval holds.
    TooMany = 14,
    /// The instrument has frozen: it repeats the same numbers under running stamps.
    Stuck = 15,
}

/// Every reason in the order of its number.
pub const REJECT_REASONS: [RejectReason; 16] = [
    RejectReason::NotFinite,
    RejectReason::OutOfRange,
    RejectReason::Duplicate,
    RejectReason::BackwardsTime,
    RejectReason::OlderThanWindow,
    RejectReason::BeforeStart,
    RejectReason::UnknownBuoy,
    RejectReason::StaleBuoy,
    RejectReason::WhileDeep,
    RejectReason::NearVertical,
    RejectReason::Gated,
    RejectReason::Disabled,
    RejectReason::Malformed,
    RejectReason::NoImu,
    RejectReason::TooMany,
    RejectReason::Stuck,
];

impl RejectReason {
    /// The word in tables and in `summary.json`.
    pub const fn name(self) -> &'static str {
        match self {
            RejectReason::NotFinite => "not_finite",
            RejectReason::OutOfRange => "out_of_range",
            RejectReason::Duplicate => "duplicate",
            RejectReason::BackwardsTime => "backwards_time",
            RejectReason::OlderThanWindow => "older_than_window",
            RejectReason::BeforeStart => "before_start",
            RejectReason::UnknownBuoy => "unknown_buoy",
            RejectReason::StaleBuoy => "stale_buoy",
            RejectReason::WhileDeep => "while_deep",
            RejectReason::NearVertical => "near_vertical",
            RejectReason::Gated => "gated",
            RejectReason::Disabled => "disabled",
            RejectReason::Malformed => "malformed",
            RejectReason::NoImu => "no_imu",
            RejectReason::TooMany => "too_many",
            RejectReason::Stuck => "stuck",
        }
    }

    /// Index into tables of counts.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The reason of that number, as it crosses the bus.
    pub fn from_index(index: u32) -> Option<RejectReason> {
        REJECT_REASONS.get(index as usize).copied()
    }
}

impl core::fmt::Display for RejectReason {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_in_the_order_of_the_numbers() {
        for (index, reason) in REJECT_REASONS.into_iter().enumerate() {
            assert_eq!(reason.index(), index, "{reason}");
        }
    }
}
