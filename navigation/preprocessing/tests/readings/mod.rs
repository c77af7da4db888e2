//! Plain readings to test with; times in seconds.

use shared_types::{
    BuoyFix, Config, DvlVelocity, GnssFix, Header, ImuSample, LblRange, McpHeading, PsDepth, RawReading, Time,
};

pub(crate) const LAT_DEG: f64 = 36.0;
pub(crate) const LON_DEG: f64 = 127.0;

fn header(t: f64) -> Header {
    Header::at(Time::from_seconds(t))
}

/// At rest and level.
pub(crate) fn imu(t: f64) -> ImuSample {
    ImuSample { header: header(t), gyro_body: [0.0; 3], accel_body: [0.0, 0.0, 9.8] }
}

pub(crate) fn raw_imu(t: f64) -> RawReading {
    RawReading::Imu(imu(t))
}

/// Moored at the origin of the test frame.
pub(crate) fn buoy_fix(t: f64, buoy: u32) -> BuoyFix {
    BuoyFix { header: header(t), buoy, moored: 1, lat_deg: LAT_DEG, lon_deg: LON_DEG, height: 0.0 }
}

pub(crate) fn buoy(t: f64, buoy: u32) -> RawReading {
    RawReading::Buoy(buoy_fix(t, buoy))
}

/// A fix `dlat` degrees north of the origin of the test frame.
pub(crate) fn gnss(t: f64, dlat: f64) -> RawReading {
    let fix =
        GnssFix { header: header(t), lat_deg: LAT_DEG + dlat, lon_deg: LON_DEG, height: 0.0, sigma_enu: [1.0; 3] };
    RawReading::Gnss(fix)
}

pub(crate) fn dvl(t: f64, forward: f64) -> RawReading {
    RawReading::Dvl(DvlVelocity { header: header(t), velocity_dvl: [forward, 0.0, 0.0] })
}

pub(crate) fn mcp(t: f64, heading_deg: f64) -> RawReading {
    RawReading::Mcp(McpHeading { header: header(t), heading_deg })
}

pub(crate) fn ps(t: f64, depth: f64) -> RawReading {
    RawReading::Ps(PsDepth { header: header(t), depth })
}

pub(crate) fn lbl(t: f64, buoy: u32, range: f64) -> RawReading {
    RawReading::Lbl(LblRange { header: header(t), buoy, in_epoch: 0, range })
}

/// The test frame, and a known attitude, so that nothing waits for an initialisation.
pub(crate) fn config() -> Config {
    let mut config = Config::default();
    config.vehicle.frame.origin_geodetic = Some([LAT_DEG.to_radians(), LON_DEG.to_radians(), 0.0]);
    config.vehicle.initial.q_enu_body = Some([1.0, 0.0, 0.0, 0.0]);
    config
}
