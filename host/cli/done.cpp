#include "done.h"

#include <fmt/format.h>

#include <array>
#include <fstream>
#include <span>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/formfactor/iff_file.h"
#include "interflect/formfactor/iff_format.h"
#include "report.h"

namespace interflect::cli {

namespace {

using nlohmann::ordered_json;

/// 128 bits over a file's content.
std::string hash_of_file(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  std::vector<char> chunk(std::size_t{1} << 20);
  std::array<std::uint64_t, 2> sum{1, 2};
  std::uint64_t bytes = 0;
  while (stream) {
    stream.read(chunk.data(), static_cast<std::streamsize>(chunk.size()));
    const auto got = static_cast<std::size_t>(stream.gcount());
    for (std::uint64_t& half : sum) half = iff::checksum(std::as_bytes(std::span(chunk.data(), got)), half);
    bytes += got;
  }
  if (!stream.eof()) throw input_error(path.string(), 0, "cannot be read");
  return fmt::format("{}:{}", iff::hex(sum), bytes);
}

/// The file of form factors, which is an output as well as an input: what its content depends on.
ordered_json form_factors_of(const SolveJob& job) {
  const std::string& file = job.solving.form_factors;
  if (file.empty()) return nullptr;
  const iff::Key key = IffFile::open_panels(file).shape().key;
  return {{"file", file},
          {"geometry", iff::hex(key.geometry)},
          {"accuracy", key.eps},
          {"seed", key.seed},
          {"maker", key.maker}};
}

ordered_json outputs_now(const SolveJob& job) {
  ordered_json out = ordered_json::array();
  for (const std::string& file : outputs_of(job)) out.push_back({{"file", file}, {"hash", hash_of_file(file)}});
  return out;
}

}  // namespace

std::string done_file(const SolveJob& job) {
  const std::vector<std::string> outputs = outputs_of(job);
  return outputs.empty() ? "" : outputs.front() + ".done";
}

ordered_json made_from(const PlannedJob& planned, const Scene& scene) {
  ordered_json out;
  out["interflect"] = INTERFLECT_VERSION;
  out["options"] = ordered_json::object();
  for (const auto& [name, values] : planned.options) {
    if (name != "checkpoint" && name != "every") out["options"][name] = values;  // they change no result
  }
  out["scene"] = ordered_json::array();
  for (const std::filesystem::path& file : scene.files) {
    out["scene"].push_back({{"file", file.filename().string()}, {"hash", hash_of_file(file)}});
  }
  return out;
}

bool is_done(const PlannedJob& planned) {
  const std::string note = done_file(planned.job);
  std::error_code missing;
  if (note.empty() || !std::filesystem::exists(note, missing)) return false;
  try {
    const ordered_json noted = ordered_json::parse(read_file(note));
    if (noted.at("outputs") != outputs_now(planned.job)) return false;
    if (noted.at("form_factors") != form_factors_of(planned.job)) return false;
    return noted.at("made_from") == made_from(planned, read_scene(planned.job.scene.file));
  } catch (const Error&) {
    return false;  // a file is gone, or is another: the job itself will say what is wrong
  } catch (const std::exception&) {
    return false;  // the note is damaged, or there is no memory for the scene: solving will say so
  }
}

void note_done(const PlannedJob& planned, const ordered_json& made_from) {
  AtomicFile file(done_file(planned.job));
  file.write(dump({{"made_from", made_from},
                   {"outputs", outputs_now(planned.job)},
                   {"form_factors", form_factors_of(planned.job)}}));
  file.commit();
}

}  // namespace interflect::cli
