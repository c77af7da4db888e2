#include "log.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <toml++/toml.h>

namespace peer {
namespace {

constexpr double kDeg = M_PI / 180;
// A track of several fixes is held so long beyond its ends, s.
constexpr double kBuoyMaxAge = 30;
// What the navigator takes for impossible, m and m/s.
constexpr double kMaxRange = 15000, kMaxSpeed = 60, kMaxDepth = 12000;

// `12.5` to nanoseconds, digit by digit.
Time ParseTime(const std::string& text) {
  std::size_t i = 0;
  const bool negative = !text.empty() && text[0] == '-';
  if (negative || (!text.empty() && text[0] == '+')) ++i;
  if (text.find_first_of("eE") != std::string::npos) return std::llround(std::strtod(text.c_str(), nullptr) * 1e9);
  Time whole = 0;
  for (; i < text.size() && text[i] != '.'; ++i) whole = 10 * whole + (text[i] - '0');
  Time fraction = 0, scale = 1000000000;
  for (++i; i < text.size() && scale > 1; ++i) {
    scale /= 10;
    fraction += scale * (text[i] - '0');
  }
  const Time t = whole * 1000000000 + fraction;
  return negative ? -t : t;
}

struct Row {
  Time t;
  std::vector<double> values;  // NaN where empty
  bool operator==(const Row& o) const { return t == o.t && values == o.values; }
};

// Rows of one file, columns by name; none where there is no file. An exact duplicate of the row before is dropped.
std::vector<Row> ReadCsv(const std::string& path, const std::vector<std::string>& columns) {
  std::ifstream in(path);
  if (!in) return {};
  std::string line;
  std::getline(in, line);
  if (!line.empty() && line.back() == '\r') line.pop_back();
  std::map<std::string, std::size_t> at;
  std::stringstream header(line);
  std::size_t width = 0;
  for (std::string name; std::getline(header, name, ','); ++width) at[name] = width;
  if (!at.count("t")) throw LogError(path + ":1: no column `t`");
  std::vector<std::size_t> wanted;
  for (const auto& column : columns) {
    if (!at.count(column)) throw LogError(path + ":1: no column `" + column + "`");
    wanted.push_back(at[column]);
  }
  std::vector<Row> rows;
  std::vector<std::string> cells;
  for (std::size_t number = 2; std::getline(in, line); ++number) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.empty()) continue;
    cells.clear();
    for (std::size_t from = 0;;) {
      const std::size_t to = line.find(',', from);
      cells.push_back(line.substr(from, to == std::string::npos ? to : to - from));
      if (to == std::string::npos) break;
      from = to + 1;
    }
    cells.resize(width);
    Row row{ParseTime(cells[at["t"]]), {}};
    for (const std::size_t index : wanted) {
      const std::string& cell = cells[index];
      char* end = nullptr;
      const double value = cell.empty() ? NAN : std::strtod(cell.c_str(), &end);
      if (!cell.empty() && *end != '\0') {
        throw LogError(path + ":" + std::to_string(number) + ": " + cell + " is not a number");
      }
      row.values.push_back(value);
    }
    if (!rows.empty() && row.t < rows.back().t) {
      throw LogError(path + ":" + std::to_string(number) + ": time runs backwards");
    }
    if (rows.empty() || !(row == rows.back())) rows.push_back(std::move(row));
  }
  return rows;
}

// sensors.toml with the documented defaults.
class Facts {
 public:
  Facts(const std::string& path) : path_(path) {
    try {
      table_ = toml::parse_file(path);
    } catch (const toml::parse_error& error) {
      throw LogError(path + ": " + std::string(error.description()));
    }
  }
  double Number(const char* section, const char* key, double otherwise) const {
    return table_[section][key].value<double>().value_or(otherwise);
  }
  Vector3d Vector(const char* section, const char* key, const Vector3d& otherwise) const {
    const auto* array = table_[section][key].as_array();
    if (!array) return otherwise;
    if (array->size() != 3) throw LogError(path_ + ": " + section + "." + key + " needs three numbers");
    return {(*array)[0].value<double>().value(), (*array)[1].value<double>().value(),
            (*array)[2].value<double>().value()};
  }
  // A key that these peers cannot do without: they have no initialisation of their own.
  const toml::array& Needed(const char* section, const char* key, std::size_t size) const {
    const auto* array = table_[section][key].as_array();
    if (!array || array->size() != size) {
      throw LogError(path_ + ": " + section + "." + key + " is needed: the peers start from a given state");
    }
    return *array;
  }

 private:
  std::string path_;
  toml::table table_;
};

Vehicle ReadVehicle(const Facts& facts) {
  Vehicle v;
  const Vector3d zero = Vector3d::Zero();
  v.initial.t = std::llround(facts.Number("initial", "t", 0) * 1e9);
  facts.Needed("initial", "position", 3);
  facts.Needed("initial", "velocity", 3);
  v.initial.position = facts.Vector("initial", "position", zero);
  v.initial.velocity = facts.Vector("initial", "velocity", zero);
  const auto& q = facts.Needed("initial", "quaternion", 4);
  const auto component = [&q](int i) { return q[i].value<double>().value(); };
  v.initial.q = Quaterniond(component(0), component(1), component(2), component(3)).normalized();
  v.initial.sigma_position = facts.Number("initial", "sigma_position", 1);
  v.initial.sigma_velocity = facts.Number("initial", "sigma_velocity", 0.1);
  v.initial.sigma_attitude = kDeg * facts.Vector("initial", "sigma_attitude", {0.5, 0.5, 2});
  v.imu = {facts.Number("imu", "gyro_noise_density", 2.9e-5),   facts.Number("imu", "accel_noise_density", 1e-3),
           facts.Number("imu", "gyro_bias_random_walk", 1e-7),  facts.Number("imu", "accel_bias_random_walk", 1e-6),
           facts.Number("imu", "gyro_bias_sigma", 1.2e-4),      facts.Number("imu", "accel_bias_sigma", 1e-3),
           facts.Number("imu", "gap", 0.02)};
  v.lbl_sigma = facts.Number("lbl", "sigma", 0.3);
  v.buoy_sigma = facts.Number("lbl", "buoy_sigma", 0);
  v.lbl_lever = facts.Vector("lbl", "lever_arm", zero);
  v.gnss_sigma = facts.Vector("gnss", "sigma", {2, 2, 4});
  v.gnss_lever = facts.Vector("gnss", "lever_arm", zero);
  v.dvl_sigma = facts.Number("dvl", "sigma", 0.01);
  v.dvl_lever = facts.Vector("dvl", "lever_arm", zero);
  const Vector3d rpy = kDeg * facts.Vector("dvl", "mounting_rpy", zero);
  using Eigen::AngleAxisd;
  v.r_body_dvl = (AngleAxisd(rpy.z(), Vector3d::UnitZ()) * AngleAxisd(rpy.y(), Vector3d::UnitY()) *
                  AngleAxisd(rpy.x(), Vector3d::UnitX()))
                     .toRotationMatrix();
  v.mcp_sigma = kDeg * facts.Number("mcp", "sigma", 0.01);
  v.mcp_declination = kDeg * facts.Number("mcp", "declination", 0);
  v.ps_sigma = facts.Number("ps", "sigma", 0.01);
  v.ps_lever = facts.Vector("ps", "lever_arm", zero);
  return v;
}

// Interpolated between fixes; a single one holds for ever. False where no fix is near enough.
bool BuoyAt(const std::vector<std::pair<Time, Vector3d>>& track, Time t, Vector3d* enu) {
  const auto next = std::upper_bound(track.begin(), track.end(), t, [](Time a, const auto& b) { return a < b.first; });
  if (next == track.begin() || next == track.end()) {
    const auto& end = next == track.begin() ? track.front() : track.back();
    *enu = end.second;
    return track.size() == 1 || std::abs(Seconds(t - end.first)) <= kBuoyMaxAge;
  }
  const auto& before = *(next - 1);
  const double share = Seconds(t - before.first) / Seconds(next->first - before.first);
  *enu = before.second + share * (next->second - before.second);
  return true;
}

void ReadReadings(const std::string& dir, const std::set<std::string>& without, Log* log) {
  const auto rows = [&](const char* name, const std::vector<std::string>& columns) {
    return without.count(name) ? std::vector<Row>() : ReadCsv(dir + "/" + name + ".csv", columns);
  };
  const auto add = [log](Time t, Sensor sensor, const Vector3d& value, const Vector3d& sigma = Vector3d::Zero(),
                         const Vector3d& buoy = Vector3d::Zero()) {
    if (t >= log->vehicle.initial.t && value.allFinite()) log->readings.push_back({t, sensor, value, sigma, buoy});
  };
  std::map<int, std::vector<std::pair<Time, Vector3d>>> buoys;
  for (const Row& row : ReadCsv(dir + "/buoys.csv", {"buoy", "lat", "lon", "h"})) {
    const auto& x = row.values;
    buoys[static_cast<int>(x[0])].emplace_back(row.t,
                                               log->world.frame.ToEnu(Geodetic::FromDegrees(x[1], x[2], x[3])));
  }
  for (const Row& row : rows("lbl", {"buoy", "range"})) {
    Vector3d buoy;
    const auto track = buoys.find(static_cast<int>(row.values[0]));
    if (track == buoys.end() || !BuoyAt(track->second, row.t, &buoy)) continue;
    const double range = row.values[1];
    if (range > 0 && range < kMaxRange) add(row.t, Sensor::kLbl, {range, 0, 0}, Vector3d::Zero(), buoy);
  }
  for (const Row& row : rows("gnss", {"lat", "lon", "h", "se", "sn", "su"})) {
    const auto& x = row.values;
    Vector3d sigma(x[3], x[4], x[5]);
    for (int i = 0; i < 3; ++i) sigma[i] = sigma[i] > 0 ? sigma[i] : log->vehicle.gnss_sigma[i];
    add(row.t, Sensor::kGnss, log->world.frame.ToEnu(Geodetic::FromDegrees(x[0], x[1], x[2])), sigma);
  }
  for (const Row& row : rows("dvl", {"vx", "vy", "vz"})) {
    const Vector3d v(row.values[0], row.values[1], row.values[2]);
    if (v.norm() <= kMaxSpeed) add(row.t, Sensor::kDvl, v);
  }
  for (const Row& row : rows("mcp", {"heading"})) {
    add(row.t, Sensor::kMcp, {row.values[0] * kDeg + log->vehicle.mcp_declination, 0, 0});
  }
  for (const Row& row : rows("ps", {"depth"})) {
    if (std::abs(row.values[0]) <= kMaxDepth) add(row.t, Sensor::kPs, {row.values[0], 0, 0});
  }
  std::stable_sort(log->readings.begin(), log->readings.end(),
                   [](const Reading& a, const Reading& b) { return a.t < b.t; });
}

}  // namespace

Log ReadLog(const std::string& dir, const std::set<std::string>& without) {
  const Facts facts(dir + "/sensors.toml");
  facts.Needed("frame", "origin", 3);
  const Vector3d origin = facts.Vector("frame", "origin", Vector3d::Zero());
  Log log{ReadVehicle(facts),
          World{LocalFrame(Geodetic::FromDegrees(origin.x(), origin.y(), origin.z())),
                facts.Number("frame", "surface_height", 0)},
          {},
          {},
          0};
  for (const Row& row : ReadCsv(dir + "/imu.csv", {"wx", "wy", "wz", "fx", "fy", "fz"})) {
    const auto& x = row.values;
    const ImuSample sample{row.t, {x[0], x[1], x[2]}, {x[3], x[4], x[5]}};
    const bool is_new = log.imu.empty() || sample.t > log.imu.back().t;
    if (is_new && sample.gyro_body.allFinite() && sample.accel_body.allFinite()) log.imu.push_back(sample);
  }
  if (log.imu.size() < 2) throw LogError(dir + "/imu.csv: no IMU samples; a log without them cannot be navigated");
  std::vector<Time> periods;
  for (std::size_t i = 1; i < log.imu.size(); ++i) periods.push_back(log.imu[i].t - log.imu[i - 1].t);
  std::nth_element(periods.begin(), periods.begin() + periods.size() / 2, periods.end());
  log.imu_period = Seconds(periods[periods.size() / 2]);
  ReadReadings(dir, without, &log);
  return log;
}

}  // namespace peer
