"""A random vehicle, its random instruments, and what they say on a random way: a log directory.

Everything is drawn from the seed: four grades of IMU at 50 to 400 Hz, which sensors are fitted, their rates, sigmas, lever arms, mounting
and outages, one to eight buoys that answer at once or in turn and lie where no survey has them, a start that is given or has to be
found, a current, latitudes up to 75 deg, and in a third of the worlds outliers of every aiding sensor.
"""

from pathlib import Path

import numpy as np

from geodesy import (EARTH_RATE, apply, ecef, enu_axes, geodetic, gravity, quaternion, rotation, transposed)

# Noise densities of gyroscope and accelerometer, random walks of their biases, 1-sigma of these at switch-on; SI units.
GRADES = {
    "fog": (2.9e-6, 5e-4, 1e-8, 1e-6, 5e-7, 5e-4),
    "tactical": (2.9e-5, 1e-3, 1e-7, 1e-5, 5e-6, 3e-3),
    "mems": (1e-4, 1.5e-3, 5e-6, 5e-5, 1e-3, 2e-2),
    "cheap": (1e-3, 5e-3, 2e-5, 1e-4, 5e-3, 0.1),
}
# For derivatives of the way, s.
STEP = 1e-4


def numbers(values):
    return "[" + ", ".join(f"{value:.10g}" for value in values) + "]"


class World:
    def __init__(self, seed):
        self.rng = rng = np.random.default_rng(seed)
        uniform = rng.uniform
        self.duration = uniform(400, 800)
        self.grade, self.rate = str(rng.choice(list(GRADES))), int(rng.choice([50, 100, 200, 400]))
        self.t_zero = float(rng.choice([0.0, 1000.5, 1.7e9]))
        self.lat, self.lon = np.radians(uniform(-75, 75)), np.radians(uniform(-180, 180))
        self.origin, self.axes = ecef(self.lat, self.lon, 0.0), enu_axes(self.lat, self.lon)
        self.earth_rate = self.axes @ np.array([0, 0, EARTH_RATE])
        self.starts_given = rng.random() < 0.75
        self.has_outliers = rng.random() < 0.35
        self.surface = round(uniform(-40, 40), 2) if rng.random() < 0.3 else 0.0
        # The way: steps of heading, speed and depth, each smooth, on a swell.
        times = np.sort(uniform(40, self.duration, rng.integers(3, 14)))
        self.turns = [(t, uniform(-np.pi, np.pi) if rng.random() < 0.4 else np.pi / 2 * rng.choice([-1, 1]),
                       uniform(2, 12)) for t in times]
        self.yaw, self.speed = uniform(-np.pi, np.pi), uniform(0.3, 2.5)
        self.speed_steps = [(t, uniform(-0.4, 0.4) * self.speed, uniform(3, 10))
                            for t in uniform(40, self.duration, 4)]
        self.dives = [(t, uniform(0, 10) * 10 ** uniform(-0.5, 0.7), uniform(5, 20))
                      for t in np.sort(uniform(100, self.duration, 4))]
        self.swell = [(np.radians(uniform(0.2, 4)), uniform(3, 12), uniform(0, 6)) for _ in range(3)]
        self.sideways, self.current = uniform(-0.15, 0.15), uniform(-0.3, 0.3, 2)
        self.place = uniform(-1, 1, 2) * rng.choice([50, 200, 800])
        self.fitted = self.draw_sensors()

    def draw_sensors(self):
        chances = {"lbl": 0.85, "dvl": 0.75, "mcp": 0.65, "ps": 0.8, "gnss": 0.35}
        fitted = {sensor for sensor, chance in chances.items() if self.rng.random() < chance}
        if not self.starts_given:
            fitted |= {"gnss", "mcp"}
        self.buoys = int(self.rng.choice([1, 2, 3, 4, 4, 5, 6, 8])) if "lbl" in fitted else 0
        # A place has to be known, or at least the way from it.
        if not fitted & {"lbl", "gnss"} or self.buoys in (1, 2):
            fitted |= {"dvl"}
        if self.buoys == 1:
            fitted |= {"mcp"}
        return fitted

    def describe(self):
        start = "given" if self.starts_given else "found"
        sensors = " ".join(sensor for sensor in ("lbl", "dvl", "mcp", "ps", "gnss") if sensor in self.fitted)
        outliers = ", outliers" if self.has_outliers else ""
        return f"{self.grade} {self.rate} Hz, start {start}, {sensors}, {self.buoys} buoys{outliers}"

    # The way, as functions of time in s.

    def under_way(self, t):
        return np.ones_like(t) if self.starts_given else 0.5 * (1 + np.tanh((t - 30) / 3))

    def attitude(self, t):
        swell = [size * np.sin(2 * np.pi * t / period + phase) * self.under_way(t) for size, period, phase in self.swell]
        yaw = self.yaw + 0.5 * swell[2]
        for middle, step, width in self.turns:
            yaw = yaw + step * 0.5 * (1 + np.tanh((t - middle) / width))
        return rotation(swell[0], swell[1] - 0.02, yaw), yaw

    def velocity(self, t):
        speed = self.speed + np.zeros_like(t)
        for middle, step, width in self.speed_steps:
            speed = speed + step * 0.5 * (1 + np.tanh((t - middle) / width))
        going = self.under_way(t)
        ahead, yaw = speed * going, self.attitude(t)[1]
        left = self.sideways * ahead
        sinking = sum(step * 0.5 / width / np.cosh((t - middle) / width) ** 2 for middle, step, width in self.dives)
        return np.stack([
            ahead * np.cos(yaw) - left * np.sin(yaw) + self.current[0] * going,
            ahead * np.sin(yaw) + left * np.cos(yaw) + self.current[1] * going,
            -sinking * going,
        ], -1)

    def turn_rate(self, t):
        relative = transposed(self.attitude(t - STEP)[0]) @ self.attitude(t + STEP)[0]
        twice = [relative[..., 2, 1] - relative[..., 1, 2], relative[..., 0, 2] - relative[..., 2, 0],
                 relative[..., 1, 0] - relative[..., 0, 1]]
        return np.stack(twice, -1) / (4 * STEP)

    def solve_way(self):
        """Positions at the samples of the IMU, by Simpson's rule; between them by Hermite's polynomial."""
        dt = 1 / self.rate
        t = np.arange(int(self.duration * self.rate) + 1) * dt
        velocity, between = self.velocity(t), self.velocity(t[:-1] + dt / 2)
        way = np.zeros((len(t), 3))
        way[1:] = np.cumsum(dt / 6 * (velocity[:-1] + 4 * between + velocity[1:]), 0)
        self.t, self.v, self.p = t, velocity, way + [*self.place, self.surface - 0.2]

    def position(self, t):
        dt = 1 / self.rate
        i = np.clip((t / dt).astype(int), 0, len(self.t) - 2)
        x = ((t - self.t[i]) / dt)[:, None]
        return ((1 + 2 * x) * (1 - x) ** 2 * self.p[i] + x * (1 - x) ** 2 * dt * self.v[i]
                + x * x * (3 - 2 * x) * self.p[i + 1] + x * x * (x - 1) * dt * self.v[i + 1])

    def geodetic(self, position):
        return geodetic(self.origin + position @ self.axes)

    def local_axes(self, position):
        """Of east, north, up at the vehicle, in those of the origin."""
        lat, lon, _ = self.geodetic(position)
        return enu_axes(lat, lon) @ self.axes.T

    # The log.

    def write(self, folder):
        self.folder = Path(folder)
        self.folder.mkdir(parents=True)
        self.solve_way()
        self.facts = [f"[frame]\norigin = [{np.degrees(self.lat):.14g}, {np.degrees(self.lon):.14g}, 0.0]\n"
                      f"surface_height = {self.surface}"]
        self.write_imu()
        self.write_truth()
        if self.starts_given:
            self.give_start()
        for sensor in ("lbl", "gnss", "dvl", "mcp", "ps"):
            if sensor in self.fitted:
                getattr(self, f"write_{sensor}")()
        (self.folder / "sensors.toml").write_text("\n".join(self.facts) + "\n")

    def normal(self, *shape):
        return self.rng.standard_normal(shape)

    def stamps(self, t):
        for ns in np.round(t * 1e9).astype(np.int64) + int(self.t_zero * 10) * 10**8:
            yield f"{ns // 10**9}.{ns % 10**9:09d}"

    def table(self, sensor, header, t, rows):
        lines = (f"{stamp},{','.join(row)}\n" for stamp, row in zip(self.stamps(t), rows))
        (self.folder / f"{sensor}.csv").write_text(f"t,{header}\n" + "".join(lines))

    def times(self, rate):
        """When a sensor speaks: at its rate, less some that are lost and, of one in three, a silence."""
        t = np.arange(self.rng.uniform(0.01, 1 / rate), self.duration - 1, 1 / rate)
        heard = self.rng.random(len(t)) > self.rng.uniform(0, 0.15)
        if self.rng.random() < 0.3:
            start = self.rng.uniform(60, self.duration - 60)
            heard &= ~((t > start) & (t < start + self.rng.uniform(10, 60)))
        return t[heard]

    def wild(self, count, share):
        """Which readings are outliers."""
        return (self.rng.random(count) < share) & self.has_outliers

    def lever_arm(self):
        return np.round(self.rng.uniform(-0.8, 0.8, 3), 3) if self.rng.random() < 0.7 else np.zeros(3)

    def write_imu(self):
        t, attitude = self.t, self.attitude(self.t)[0]
        lat, _, height = self.geodetic(self.p)
        up = self.local_axes(self.p)[..., 2, :]
        acceleration = (self.velocity(t + STEP) - self.velocity(t - STEP)) / (2 * STEP)
        force = acceleration + 2 * np.cross(self.earth_rate, self.v) + gravity(lat, height)[:, None] * up
        into_body = transposed(attitude)
        gyro_density, accel_density, gyro_walk, accel_walk, gyro_bias, accel_bias = GRADES[self.grade]

        def disturb(exact, density, walk, bias):
            drift = walk / np.sqrt(self.rate) * np.cumsum(self.normal(len(t), 3), 0)
            return exact + bias * self.normal(1, 3) + drift + density * np.sqrt(self.rate) * self.normal(len(t), 3)

        earth = apply(into_body, np.broadcast_to(self.earth_rate, self.p.shape))
        rows = np.hstack([disturb(self.turn_rate(t) + earth, gyro_density, gyro_walk, gyro_bias),
                          disturb(apply(into_body, force), accel_density, accel_walk, accel_bias)])
        self.table("imu", "wx,wy,wz,fx,fy,fz", t, (("%.12g" % x for x in row) for row in rows))
        self.facts.append(
            f"[imu]\ngyro_noise_density = {gyro_density}\naccel_noise_density = {accel_density}\n"
            f"gyro_bias_random_walk = {gyro_walk}\naccel_bias_random_walk = {accel_walk}\n"
            f"gyro_bias_sigma = {gyro_bias}\naccel_bias_sigma = {accel_bias}")

    def write_truth(self):
        t = self.t[:: max(1, self.rate // 10)]
        places = np.stack(self.geodetic(self.position(t)), -1)
        turned, speeds = self.attitude(t)[0], self.velocity(t)
        rows = ([f"{np.degrees(lat):.12f}", f"{np.degrees(lon):.12f}", f"{height:.6f}",
                 *("%.12g" % x for x in (*quaternion(matrix), *velocity))]
                for (lat, lon, height), matrix, velocity in zip(places, turned, speeds))
        self.table("truth", "lat,lon,h,qw,qx,qy,qz,ve,vn,vu", t, rows)

    def give_start(self):
        uniform = self.rng.uniform
        position, velocity = 10 ** uniform(-0.5, 1), uniform(0.02, 0.2)
        attitude = np.array([uniform(0.1, 1), uniform(0.1, 1), 10 ** uniform(-0.3, 1)])
        about = np.radians(attitude) * self.normal(3)
        zero = np.array(0.0)
        turned = rotation(zero, zero, about[2]) @ self.attitude(self.t[:1])[0][0] @ rotation(about[0], about[1], zero)
        self.facts.append(
            f"[initial]\nt = {self.t_zero}\nposition = {numbers(self.p[0] + position * self.normal(3))}\n"
            f"velocity = {numbers(self.v[0] + velocity * self.normal(3))}\nquaternion = {numbers(quaternion(turned))}\n"
            f"sigma_position = {position:.4g}\nsigma_velocity = {velocity:.4g}\nsigma_attitude = {numbers(attitude)}")

    def write_lbl(self):
        rng, uniform, count = self.rng, self.rng.uniform, self.buoys
        middle, extent = self.p.mean(0), max(200, np.ptp(self.p[:, :2], axis=0).max())
        heights = self.surface - uniform(0, 5, count)
        if rng.random() < 0.3:
            heights = self.p[:, 2].min() - uniform(5, 80, count)
        buoys = np.column_stack([middle[:2] + uniform(-extent, extent, (count, 2)), heights])
        sigma, survey = 10 ** uniform(-1, 0.3), float(rng.choice([0, 0, 0.1, 0.5]))
        lever_arm = self.lever_arm()
        between = 0.0 if rng.random() < 0.5 else 0.05
        asked = self.times(1 / rng.choice([1, 1, 2, 5, 10]))
        answers = [(t + between * (buoy + 1), buoy) for t in asked for buoy in range(count) if rng.random() > 0.1]
        t, buoy = (np.array(column) for column in zip(*sorted(answers)))
        transducer = self.position(t) + apply(self.attitude(t)[0], lever_arm)
        ranges = np.linalg.norm(buoys[buoy] - transducer, axis=-1) + sigma * self.normal(len(t))
        late = self.wild(len(t), uniform(0.02, 0.2))
        ranges[late] += rng.exponential(30, late.sum())
        self.table("lbl", "buoy,range", t, ((str(b + 1), f"{z:.4f}") for b, z in zip(buoy, ranges)))
        surveyed = np.stack(self.geodetic(buoys + survey * self.normal(count, 3)), -1)
        self.table("buoys", "buoy,lat,lon,h", np.zeros(count),
                   ((str(b + 1), f"{np.degrees(lat):.12f}", f"{np.degrees(lon):.12f}", f"{height:.5f}")
                    for b, (lat, lon, height) in enumerate(surveyed)))
        self.facts.append(f"[lbl]\nsigma = {sigma:.4g}\nlever_arm = {numbers(lever_arm)}\nreference_buoy = 1\n"
                          f"buoy_sigma = {survey}")

    def write_gnss(self):
        uniform, lever_arm = self.rng.uniform, self.lever_arm()
        sigmas = np.array([1, 1, 2]) * 10 ** uniform(-1.5, 0.6)
        t = self.times(self.rng.choice([1, 5, 0.2]))
        if self.rng.random() < 0.6:
            t = t[t < uniform(40, 120)]
        t = t[self.position(t)[:, 2] > self.surface - 0.8]
        antenna = self.position(t) + apply(self.attitude(t)[0], lever_arm)
        antenna = antenna + apply(transposed(self.local_axes(antenna)), sigmas * self.normal(len(t), 3))
        wild = self.wild(len(t), 0.05)
        antenna[wild] += 30 * self.normal(wild.sum(), 3)
        self.table("gnss", "lat,lon,h,se,sn,su", t,
                   ((f"{np.degrees(lat):.11f}", f"{np.degrees(lon):.11f}", f"{height:.5f}",
                     *(f"{sigma:.5g}" for sigma in sigmas))
                    for lat, lon, height in zip(*self.geodetic(antenna))))
        self.facts.append(f"[gnss]\nlever_arm = {numbers(lever_arm)}")

    def write_dvl(self):
        uniform, lever_arm = self.rng.uniform, self.lever_arm()
        mounting = [uniform(-3, 3), uniform(-3, 3), uniform(-180, 180)] if self.rng.random() < 0.4 else [0, 0, 0]
        sigma, t = 10 ** uniform(-2.7, -1.2), self.times(self.rng.choice([1, 2, 5, 8, 10]))
        body = apply(transposed(self.attitude(t)[0]), self.velocity(t)) + np.cross(self.turn_rate(t), lever_arm)
        seen = body @ rotation(*np.radians(mounting)) + sigma * self.normal(len(t), 3)
        wild = self.wild(len(t), 0.03)
        seen[wild] += self.normal(wild.sum(), 3)
        self.table("dvl", "vx,vy,vz", t, ((f"{x:.6f}" for x in row) for row in seen))
        self.facts.append(f"[dvl]\nsigma = {sigma:.4g}\nlever_arm = {numbers(lever_arm)}\n"
                          f"mounting_rpy = {numbers(mounting)}")

    def write_mcp(self):
        sigma, t = 10 ** self.rng.uniform(-1, 0.5), self.times(self.rng.choice([1, 5, 10, 20]))
        ahead = apply(self.local_axes(self.position(t)), self.attitude(t)[0][..., :, 0])
        declination = round(self.rng.uniform(-15, 15), 2) if self.rng.random() < 0.4 else 0.0
        heading = np.degrees(np.arctan2(ahead[:, 0], ahead[:, 1])) + sigma * self.normal(len(t)) - declination
        wild = self.wild(len(t), 0.03)
        heading[wild] += 40 * self.normal(wild.sum())
        self.table("mcp", "heading", t, ((f"{x % 360:.5f}",) for x in heading))
        self.facts.append(f"[mcp]\nsigma = {sigma:.4g}\ndeclination = {declination}")

    def write_ps(self):
        sigma, t = 10 ** self.rng.uniform(-2.3, -0.7), self.times(self.rng.choice([1, 5, 10, 20]))
        lever_arm = self.lever_arm()
        port = self.position(t) + apply(self.attitude(t)[0], lever_arm)
        depth = self.surface - self.geodetic(port)[2] + sigma * self.normal(len(t))
        wild = self.wild(len(t), 0.03)
        depth[wild] += 5 * self.normal(wild.sum())
        self.table("ps", "depth", t, ((f"{x:.5f}",) for x in depth))
        self.facts.append(f"[ps]\nsigma = {sigma:.4g}\nlever_arm = {numbers(lever_arm)}")
