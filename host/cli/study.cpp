#include "study.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>

#include "interflect/base/error.h"
#include "study_measure.h"

namespace interflect::cli {

namespace {

/// The study's poster, "Runtimes in Seconds": iterations and OpenMP seconds of both methods, then Jacobi as rrv had it
/// (a fixed number of iterations), serial, with CUDA; OpenMP's column is that of the first table. It has no figures of
/// AoS against SoA.
struct StudyFigures {
  unsigned patches, jacobi_iterations, bicgstab_iterations;
  double jacobi_seconds, bicgstab_seconds, original, serial, cuda;
};
constexpr std::array study_figures{StudyFigures{1312, 8, 3, 0.009, 0.010, 0.028, 0.031, 0.006},
                                   StudyFigures{3360, 28, 16, 0.045, 0.058, 0.857, 0.677, 0.115},
                                   StudyFigures{9680, 36, 17, 0.410, 0.435, 10.072, 6.973, 1.209},
                                   StudyFigures{17128, 32, 17, 0.993, 1.157, 27.855, 19.394, 3.415}};

/// The study's figures for the scene of that size.
const StudyFigures& figures_of(const StudyRoom& room) {
  const auto* const found = std::find_if(study_figures.begin(), study_figures.end(),
                                         [&](const StudyFigures& then) { return then.patches == room.patches; });
  if (found == study_figures.end()) {
    throw Error(ErrorKind::input,
                fmt::format("{} has {} patches: it is not one of the study's sizes", room.scene, room.patches));
  }
  return *found;
}

constexpr const char* serial_loop = "study:aos-serial";
constexpr const char* openmp_loop = "study:aos-openmp";

/// A cell: seconds, or why there are none.
std::string seconds(const StudyRoom& room, const std::string& device, const std::string& what) {
  const Measurement* one = find(room.all, device, what);
  if (one == nullptr || one->row.status == "unsupported") return "no device";
  if (one->row.status == "fail") return "WRONG";
  return fmt::format("{:.4f}", one->row.seconds);
}

std::string with_iterations(const StudyRoom& room, const std::string& device, const std::string& what) {
  const auto count = room.iterations.find(StudyRoom::key(device, what));
  return fmt::format("{:>4} {:>9}", count == room.iterations.end() ? 0 : count->second, seconds(room, device, what));
}

/// How many times faster `one` is than `other`, in the median of the passes; 0 where one of them did not pass.
double gain(const StudyRoom& room, const char* other, const std::string& device, const std::string& what) {
  const Measurement* slow = room.passed("host", other);
  const Measurement* fast = room.passed(device, what);
  return slow != nullptr && fast != nullptr ? median_ratio(*slow, *fast) : 0;
}

std::string times(double ratio) {
  return ratio > 0 ? fmt::format("{:.1f}", ratio) : "-";
}

nlohmann::ordered_json value(const StudyRoom& room, const std::string& device, const std::string& what) {
  const Measurement* one = room.passed(device, what);
  return one == nullptr ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(one->row.seconds);
}

nlohmann::ordered_json or_null(double ratio) {
  return ratio > 0 ? nlohmann::ordered_json(ratio) : nlohmann::ordered_json(nullptr);
}

std::string methods_table(const std::vector<StudyRoom>& rooms, const std::string& device,
                          nlohmann::ordered_json& data) {
  std::string text = fmt::format(
      "Jacobi against BiCGSTAB, to a relative residual of 1e-6 ({})\n"
      "patches |  Jacobi it, s  |  BiCGSTAB it, s |    CG it, s    | study: Jacobi it, s | BiCG-STAB it, s | form "
      "factors, s\n",
      device);
  for (const StudyRoom& room : rooms) {
    const StudyFigures& then = figures_of(room);
    text += fmt::format("{:>7} | {} |  {} | {} | {:>12} {:>6.3f} | {:>8} {:>6.3f} | {:>9.2f}\n", room.patches,
                        with_iterations(room, device, "solve:jacobi"), with_iterations(room, device, "solve:bicgstab"),
                        with_iterations(room, device, "solve:cg"), then.jacobi_iterations, then.jacobi_seconds,
                        then.bicgstab_iterations, then.bicgstab_seconds, room.form_factor_seconds);
    const auto iterations = [&](const char* what) { return room.iterations.at(StudyRoom::key(device, what)); };
    data.push_back({{"patches", room.patches},
                    {"device", device},
                    {"jacobi_iterations", iterations("solve:jacobi")},
                    {"jacobi", value(room, device, "solve:jacobi")},
                    {"bicgstab_iterations", iterations("solve:bicgstab")},
                    {"bicgstab", value(room, device, "solve:bicgstab")},
                    {"cg_iterations", iterations("solve:cg")},
                    {"cg", value(room, device, "solve:cg")},
                    {"form_factors", room.form_factor_seconds},
                    {"study",
                     {{"jacobi_iterations", then.jacobi_iterations},
                      {"jacobi", then.jacobi_seconds},
                      {"bicgstab_iterations", then.bicgstab_iterations},
                      {"bicgstab", then.bicgstab_seconds}}}});
  }
  return text;
}

std::string jacobi_table(const std::vector<StudyRoom>& rooms, const std::string& device, nlohmann::ordered_json& data) {
  std::string text = fmt::format(
      "\nJacobi in seconds: the study's plain loop (AoS) and our kernels, beside the study's figures; and how many "
      "times "
      "faster\nthan the loop CG is ({}, F in its fastest format)\n"
      "patches | loop: serial |    OpenMP | kernels: OpenMP |      CUDA |       CG, format | x serial | x OpenMP | "
      "study: "
      "original | serial |   CUDA | OpenMP\n",
      device);
  for (const StudyRoom& room : rooms) {
    const StudyFigures& then = figures_of(room);
    const std::string best = room.best_cg(device);
    const Measurement* cg = room.passed(device, best);
    const std::string format = cg == nullptr ? "-" : cg->row.storage;
    const double over_serial = gain(room, serial_loop, device, best);
    const double over_openmp = gain(room, openmp_loop, device, best);
    text += fmt::format(
        "{:>7} | {:>12} | {:>9} | {:>15} | {:>9} | {:>8} {:>7} | {:>8} | {:>8} | {:>15.3f} | {:>6.3f} | "
        "{:>6.3f} | {:>6.3f}\n",
        room.patches, seconds(room, "host", serial_loop), seconds(room, "host", openmp_loop),
        seconds(room, "openmp", "solve:jacobi"), seconds(room, "cuda:0", "solve:jacobi"), seconds(room, device, best),
        format, times(over_serial), times(over_openmp), then.original, then.serial, then.cuda, then.jacobi_seconds);
    data.push_back({{"patches", room.patches},
                    {"loop_serial", value(room, "host", serial_loop)},
                    {"loop_openmp", value(room, "host", openmp_loop)},
                    {"openmp", value(room, "openmp", "solve:jacobi")},
                    {"cuda", value(room, "cuda:0", "solve:jacobi")},
                    {"cg_device", device},
                    {"cg_storage", format},
                    {"cg", value(room, device, best)},
                    {"cg_over_loop_serial", or_null(over_serial)},
                    {"cg_over_loop_openmp", or_null(over_openmp)},
                    {"study",
                     {{"original", then.original},
                      {"serial", then.serial},
                      {"cuda", then.cuda},
                      {"openmp", then.jacobi_seconds}}}});
  }
  return text;
}

std::string layout_table(const std::vector<StudyRoom>& rooms, nlohmann::ordered_json& data) {
  std::string text =
      "\nJacobi by the plain loop in seconds, AoS against SoA vectors (the study's poster has no figures of it)\n"
      "patches | serial: AoS |       SoA | AoS/SoA | OpenMP: AoS |       SoA | AoS/SoA\n";
  for (const StudyRoom& room : rooms) {
    const double serial = gain(room, serial_loop, "host", "study:soa-serial");
    const double openmp = gain(room, openmp_loop, "host", "study:soa-openmp");
    const auto ratio = [](double r) { return r > 0 ? fmt::format("{:.2f}", r) : "-"; };
    text += fmt::format("{:>7} | {:>11} | {:>9} | {:>7} | {:>11} | {:>9} | {:>7}\n", room.patches,
                        seconds(room, "host", serial_loop), seconds(room, "host", "study:soa-serial"), ratio(serial),
                        seconds(room, "host", openmp_loop), seconds(room, "host", "study:soa-openmp"), ratio(openmp));
    data.push_back({{"patches", room.patches},
                    {"serial_aos", value(room, "host", serial_loop)},
                    {"serial_soa", value(room, "host", "study:soa-serial")},
                    {"serial_aos_over_soa", or_null(serial)},
                    {"openmp_aos", value(room, "host", openmp_loop)},
                    {"openmp_soa", value(room, "host", "study:soa-openmp")},
                    {"openmp_aos_over_soa", or_null(openmp)}});
  }
  return text;
}

}  // namespace

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const std::size_t middle = values.size() / 2;
  return values.size() % 2 == 1 ? values[middle] : (values[middle - 1] + values[middle]) / 2;
}

const std::vector<Room>& study_rooms() {
  static const std::vector<Room> rooms{
      {"room-1312.obj", 1312, 1}, {"room-3360.obj", 3360, 1}, {"room-9680.obj", 9680, 1}, {"room-17128.obj", 17128, 1}};
  return rooms;
}

std::string scenes_folder(const std::string& given) {
  std::vector<std::filesystem::path> candidates;
  if (!given.empty()) {
    candidates.emplace_back(given);
  } else {
    candidates.emplace_back("scenes");
    std::error_code ignored;
    const auto program = std::filesystem::read_symlink("/proc/self/exe", ignored).parent_path();
    candidates.push_back(program / "../../../scenes");             // build/release/bin
    candidates.push_back(program / "../share/interflect/scenes");  // installed
  }
  for (const auto& folder : candidates) {
    if (std::filesystem::exists(folder / study_rooms().front().file)) return folder.string();
  }
  throw Error(ErrorKind::usage, fmt::format("{} is not found in {}; name the folder with --scenes",
                                            study_rooms().front().file, candidates.front().string()));
}

StudyTables study_tables(const std::string& rooms, const std::string& device, unsigned repetitions,
                         const std::vector<unsigned>& only, ProgressSink& progress) {
  StudyTables out;
  std::vector<StudyRoom> measured;
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  for (const Room& room : study_rooms()) {
    if (!only.empty() && std::find(only.begin(), only.end(), room.patches) == only.end()) continue;
    const StudyRoom& one = measured.emplace_back(measure_study_room(rooms, room, device, repetitions, progress));
    for (const Measurement& measurement : one.all) {
      rows.push_back(to_json(measurement.row));
      if (measurement.row.status != "fail") continue;
      out.verified = false;
      progress.message(fmt::format("{}: {} {}: {}", one.scene, measurement.row.device, measurement.row.what,
                                   measurement.row.reason));
    }
  }
  auto methods = nlohmann::ordered_json::array(), jacobi = methods, layout = methods;
  out.text = methods_table(measured, device, methods) + jacobi_table(measured, device, jacobi) +
             layout_table(measured, layout);
  out.data = {{"rows", rows}, {"tables", {{"methods", methods}, {"jacobi", jacobi}, {"layout", layout}}}};
  return out;
}

}  // namespace interflect::cli
