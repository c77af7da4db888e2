//! Raw readings, as the instrument and the log file say them: no unit is converted before `preprocessing`.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;

use crate::header::Header;
use crate::layout::message;

message! {
    /// One IMU sample: the instantaneous rate and specific force at `t_valid`, biases included.
    ImuSample, "ilns.ImuSample.1", schema 1 {
        /// Sender, order and times.
        header: Header,
        /// Angular rate of the body against inertial space, rad/s, body frame (forward, left, up).
        gyro_body: [f64; 3],
        /// Specific force, m/s², body frame; (0, 0, +9.8) at rest and level.
        accel_body: [f64; 3],
    }
}

message! {
    /// One slant range. All ranges with one `t_valid` are one epoch (one interrogation).
    LblRange, "ilns.LblRange.1", schema 1 {
        /// Sender, order and times.
        header: Header,
        /// Number of the buoy.
        buoy: u32,
        /// How many ranges this epoch has, so that its end is known; 0 = not known, the epoch then ends by time.
        in_epoch: u32,
        /// Distance from the transducer to the buoy at `t_valid`, m.
        range: f64,
    }
}

message! {
    /// One position of a buoy.
    BuoyFix, "ilns.BuoyFix.1", schema 1 {
        /// Sender, order and times.
        header: Header,
        /// Number of the buoy.
        buoy: u32,
        /// 1: a moored buoy, this position holds for ever. 0: a drifting one, the position ages.
        moored: u32,
        /// Latitude, degrees.
        lat_deg: f64,
        /// Longitude, degrees.
        lon_deg: f64,
        /// Ellipsoidal height, m.
        height: f64,
    }
}

message! {
    /// One satellite fix of the antenna.
    GnssFix, "ilns.GnssFix.1", schema 1 {
        /// Sender, order and times.
        header: Header,
        /// Latitude, degrees.
        lat_deg: f64,
        /// Longitude, degrees.
        lon_deg: f64,
        /// Ellipsoidal height, m; NaN = not reported.
        height: f64,
        /// 1-sigma along east, north, up at the fix, m; NaN = not reported.
        sigma_enu: [f64; 3],
    }
}

message! {
    /// One Doppler velocity over ground, bottom track.
    DvlVelocity, "ilns.DvlVelocity.1", schema 1 {
        /// Sender, order and times.
        header: Header,
        /// Velocity of the transducer in the instrument's axes, m/s.
        velocity_dvl: [f64; 3],
    }
}

message! {
    /// One compass heading of the body x axis.
    McpHeading, "ilns.McpHeading.1", schema 1 {
        /// Sender, order and times.
        header: Header,
        /// Clockwise from north, degrees, before declination.
        heading_deg: f64,
    }
}

message! {
    /// One depth of the pressure port.
    PsDepth, "ilns.PsDepth.1", schema 1 {
        /// Sender, order and times.
        header: Header,
        /// Positive down from the mean surface, m.
        depth: f64,
    }
}

message! {
    /// Where the vehicle really is. For scoring only; no navigation process reads it.
    Truth, "ilns.Truth.1", schema 1 {
        /// Sender, order and times.
        header: Header,
        /// Latitude of the IMU, degrees.
        lat_deg: f64,
        /// Longitude of the IMU, degrees.
        lon_deg: f64,
        /// Ellipsoidal height of the IMU, m.
        height: f64,
        /// Body to ENU at the origin, Hamilton (w, x, y, z).
        q_enu_body: [f64; 4],
        /// Velocity in ENU at the origin, m/s.
        velocity_enu: [f64; 3],
    }
}

message! {
    /// Origin of the ENU frame, fixed for a run.
    FrameOrigin, "ilns.FrameOrigin.1", schema 1 {
        /// Sender, order and times.
        header: Header,
        /// Latitude, degrees.
        lat_deg: f64,
        /// Longitude, degrees.
        lon_deg: f64,
        /// Ellipsoidal height, m.
        height: f64,
    }
}

/// Any raw reading, in memory: what a log directory yields and what the whole navigator takes in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RawReading {
    /// IMU sample.
    Imu(ImuSample),
    /// Position of a buoy.
    Buoy(BuoyFix),
    /// Satellite fix.
    Gnss(GnssFix),
    /// Doppler velocity.
    Dvl(DvlVelocity),
    /// Compass heading.
    Mcp(McpHeading),
    /// Depth.
    Ps(PsDepth),
    /// Slant range.
    Lbl(LblRange),
}

impl RawReading {
    /// Whose reading.
    pub fn sensor(&self) -> crate::Sensor {
        match self {
            RawReading::Imu(_) => crate::Sensor::Imu,
            RawReading::Buoy(_) => crate::Sensor::Buoys,
            RawReading::Gnss(_) => crate::Sensor::Gnss,
            RawReading::Dvl(_) => crate::Sensor::Dvl,
            RawReading::Mcp(_) => crate::Sensor::Mcp,
            RawReading::Ps(_) => crate::Sensor::Ps,
            RawReading::Lbl(_) => crate::Sensor::Lbl,
        }
    }

    /// Its header.
    pub fn header(&self) -> &Header {
        match self {
            RawReading::Imu(r) => &r.header,
            RawReading::Buoy(r) => &r.header,
            RawReading::Gnss(r) => &r.header,
            RawReading::Dvl(r) => &r.header,
            RawReading::Mcp(r) => &r.header,
            RawReading::Ps(r) => &r.header,
            RawReading::Lbl(r) => &r.header,
        }
    }

    /// Data time at which it was valid.
    pub fn t_valid(&self) -> crate::Time {
        crate::Time(self.header().t_valid)
    }
}
