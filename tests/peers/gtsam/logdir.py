"""A log directory: CSV files by sensor and sensors.toml."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from earth import Frame

MAX_AGE, MIN_SPACING = 1.25, 0.2  # s, of keyframes
BUOY_MAX_AGE = 30.0  # s


@dataclass
class Reading:
    """One reading of an aiding sensor, SI units, degrees turned to radians."""

    t: float
    sensor: str
    value: np.ndarray
    sigma: np.ndarray | None = None
    buoy: int = 0
    buoy_enu: np.ndarray | None = None


@dataclass
class Log:
    """All of it."""

    facts: dict
    frame: Frame
    surface_height: float
    imu: np.ndarray  # t, gyro, specific force
    readings: list  # in order of time


def table(path, columns):
    """Columns of a CSV file by name; empty where there is no file."""
    if not path.exists():
        return np.empty((0, len(columns)))
    with open(path, encoding="utf-8") as file:
        header = file.readline().strip().split(",")
    at = [header.index(column) for column in columns]
    try:
        return np.loadtxt(path, delimiter=",", skiprows=1, usecols=at, ndmin=2)
    except ValueError:  # empty cells
        return np.atleast_2d(np.genfromtxt(path, delimiter=",", skip_header=1, usecols=at))


def read(directory, without):
    """Reads a log directory; `without`: sensors to leave out."""
    directory = Path(directory)
    facts = tomllib.loads((directory / "sensors.toml").read_text())
    frame = Frame(facts["frame"]["origin"])
    imu = table(directory / "imu.csv", ["t", "wx", "wy", "wz", "fx", "fy", "fz"])
    imu = imu[np.concatenate([[True], np.diff(imu[:, 0]) > 0])]
    log = Log(facts, frame, facts["frame"].get("surface_height", 0.0), imu, [])
    log.readings = sorted(read_readings(directory, log, without), key=lambda reading: reading.t)
    return log


def read_readings(directory, log, without):
    """Readings from the start on, by sensor."""
    start = log.facts["initial"]["t"]

    def rows(sensor, columns):
        if sensor in without:
            return []
        found = table(directory / f"{sensor}.csv", ["t", *columns])
        return [row for row in found if row[0] >= start and np.isfinite(row).all()]

    tracks = {}
    for t, buoy, lat, lon, h in table(directory / "buoys.csv", ["t", "buoy", "lat", "lon", "h"]):
        tracks.setdefault(int(buoy), []).append((t, log.frame.to_enu(lat, lon, h)))
    for t, buoy, distance in rows("lbl", ["buoy", "range"]):
        enu = buoy_at(tracks.get(int(buoy), []), t)
        if enu is not None and distance > 0:
            yield Reading(t, "lbl", distance, buoy=int(buoy), buoy_enu=enu)
    for t, lat, lon, h, se, sn, su in rows("gnss", ["lat", "lon", "h", "se", "sn", "su"]):
        yield Reading(t, "gnss", log.frame.to_enu(lat, lon, h), sigma=np.array([se, sn, su]))
    for t, *velocity in rows("dvl", ["vx", "vy", "vz"]):
        yield Reading(t, "dvl", np.array(velocity))
    for t, heading in rows("mcp", ["heading"]):
        yield Reading(t, "mcp", np.radians(heading + log.facts["mcp"].get("declination", 0.0)))
    for t, depth in rows("ps", ["depth"]):
        yield Reading(t, "ps", depth)


def buoy_at(track, t):
    """Interpolated between fixes; a single one holds for ever."""
    if not track:
        return None
    times = np.array([fix[0] for fix in track])
    if len(track) > 1 and not times[0] - BUOY_MAX_AGE <= t <= times[-1] + BUOY_MAX_AGE:
        return None
    places = np.array([fix[1] for fix in track])
    return np.array([np.interp(t, times, places[:, axis]) for axis in range(3)])


def schedule(log):
    """Keyframe times after the start, and the readings of each interval: (t, tied to the one before, tied to this one)."""
    pings = [reading.t for reading in log.readings if reading.sensor == "lbl"]
    end, last, ping, at = log.imu[-1, 0], log.facts["initial"]["t"], 0, 0
    while True:
        while ping < len(pings) and pings[ping] < last + MIN_SPACING - 1e-9:
            ping += 1
        t = min([last + MAX_AGE] + pings[ping:ping + 1])
        is_last = t > end
        t = min(t, end)
        if is_last and t - last < MIN_SPACING:
            return
        before, this = [], []
        while at < len(log.readings) and log.readings[at].t <= t:
            reading = log.readings[at]
            (before if reading.t - last <= t - reading.t else this).append(reading)
            at += 1
        yield t, before, this
        if is_last:
            return
        last = t
