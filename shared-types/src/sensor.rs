//! The sensors and their one short name from cable to table.

/// A sensor. The number is its index in every per-sensor table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u32)]
pub enum Sensor {
    /// Inertial measurement unit.
    Imu = 0,
    /// Long-baseline slant ranges.
    Lbl = 1,
    /// Satellite positions.
    Gnss = 2,
    /// Doppler velocity log.
    Dvl = 3,
    /// Magnetic compass.
    Mcp = 4,
    /// Pressure sensor.
    Ps = 5,
    /// Positions of the acoustic buoys.
    Buoys = 6,
}

/// Every sensor in the order of its number.
pub const SENSORS: [Sensor; 7] =
    [Sensor::Imu, Sensor::Lbl, Sensor::Gnss, Sensor::Dvl, Sensor::Mcp, Sensor::Ps, Sensor::Buoys];

/// The sensors that correct the inertial solution.
pub const AIDING: [Sensor; 5] = [Sensor::Lbl, Sensor::Gnss, Sensor::Dvl, Sensor::Mcp, Sensor::Ps];

impl Sensor {
    /// `imu`, `lbl`, `gnss`, `dvl`, `mcp`, `ps` or `buoys`: channel, log file, configuration section and table row.
    pub const fn name(self) -> &'static str {
        match self {
            Sensor::Imu => "imu",
            Sensor::Lbl => "lbl",
            Sensor::Gnss => "gnss",
            Sensor::Dvl => "dvl",
            Sensor::Mcp => "mcp",
            Sensor::Ps => "ps",
            Sensor::Buoys => "buoys",
        }
    }

    /// Index into per-sensor tables.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The sensor of that short name.
    pub fn from_name(name: &str) -> Option<Sensor> {
        SENSORS.into_iter().find(|sensor| sensor.name() == name)
    }

    /// The sensor of that number, as it crosses the bus.
    pub fn from_index(index: u32) -> Option<Sensor> {
        SENSORS.get(index as usize).copied()
    }
}

impl core::fmt::Display for Sensor {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_numbers_lead_back_to_the_sensor() {
        for sensor in SENSORS {
            assert_eq!(Sensor::from_name(sensor.name()), Some(sensor));
            assert_eq!(Sensor::from_index(sensor as u32), Some(sensor));
        }
        assert_eq!(Sensor::from_index(7), None);
    }
}
