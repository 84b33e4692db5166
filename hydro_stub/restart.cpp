#include "hydro_stub/restart.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <vector>

#include "proto/files/fields.hpp"
#include "proto/files/recording.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/wire/status.hpp"
#include "server/version.hpp"

namespace shearbus::hydro {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kKept = 2;

// Lists the dumps of a run, newest first: their names end in the step, with a fixed number of digits.
std::vector<fs::path> dumps_of(const fs::path& run) {
  std::vector<fs::path> found;
  std::error_code none;
  for (const fs::directory_entry& entry : fs::directory_iterator(restart_directory(run), none)) {
    if (entry.path().filename().string().starts_with("dump-") && entry.path().extension() == ".h5")
      found.push_back(entry.path());
  }
  std::ranges::sort(found, std::greater());
  return found;
}

bool is_own_history(const fs::path& file) try {
  return files::HistoryReader(file).meta("producer").value_or("").starts_with("shearbus-hydro ");
} catch (const wire::Error&) {
  return false;
}

bool is_picture(const fs::path& file) {
  return files::head_of(file, 8) == "\x89PNG\r\n\x1a\n";
}

constexpr files::FileKind kOwnHistory = {"a history of shearbus-hydro", is_own_history};
constexpr files::FileKind kPicture = {"a picture (PNG)", is_picture};

fs::path end_note(const fs::path& run) {
  return restart_directory(run) / "ended";
}

}  // namespace

fs::path restart_directory(const fs::path& run) {
  return run / "restart";
}

bool has_ended(const fs::path& run) {
  return fs::exists(end_note(run));
}

files::DumpReader newest_dump(const fs::path& run) {
  for (const fs::path& file : dumps_of(run)) {
    try {
      return files::DumpReader(file);
    } catch (const wire::Error& fault) {
      fmt::print(stderr, "shearbus-hydro: warning: a restart dump is damaged: {}\n", fault.what());
    }
  }
  throw wire::Error({.code = wire::Code::kInvalidValue,
                     .text = fmt::format("{} holds no restart dump that can be read{}", restart_directory(run).string(),
                                         has_ended(run) ? ": the run has ended, and its results are whole" : ""),
                     .remedy = "Give the directory of a run that was stopped."});
}

fs::path server_directory(const fs::path& run) {
  fs::path directory = restart_directory(run) / "server";
  fs::create_directories(directory);
  return directory;
}

void make_room_for_dumps(const fs::path& run) {
  if (dumps_of(run).empty()) {
    fs::remove_all(restart_directory(run));  // deletes the files of a run that ended before its first dump
    return;
  }
  throw wire::Error({.code = wire::Code::kInvalidValue,
                     .text = fmt::format("{} holds restart dumps of a run that was stopped", run.string()),
                     .remedy = fmt::format("Go on with it (--restart {}), remove {}, or write elsewhere (--out).",
                                           server::quoted(run.string()), restart_directory(run).string())});
}

void remove_results(const fs::path& run) {
  std::vector<std::pair<fs::path, files::FileKind>> results = {{run / "summary.json", files::kSummaryFile}};
  for (const char* history : {"history.h5", "interface.h5", "free_surface.h5"})
    results.emplace_back(run / history, kOwnHistory);
  for (const char* picture :
       {"histories", "regimes", "cone_temperature", "cone_displacement", "cone_free_surface", "cone_regime",
        "cone_interface_temperature", "cone_sliding_velocity", "cone_shear_stress", "cone_pressure"})
    results.emplace_back(run / (std::string(picture) + ".png"), kPicture);
  for (const auto& [file, kind] : results) files::check_output(file, kind);
  for (const auto& [file, kind] : results) fs::remove(file);
  files::remove_fields(run / "fields.xmf");
}

bool RestartDumps::due(std::uint64_t steps) const {
  const bool by_steps = schedule_.every_steps > 0 && steps % schedule_.every_steps == 0;
  return by_steps || (schedule_.interval_s > 0.0 &&
                      std::chrono::steady_clock::now() - last_ >= std::chrono::duration<double>(schedule_.interval_s));
}

void RestartDumps::write(std::uint64_t steps, const std::function<void(const std::string&, files::DumpWriter&)>& fill) {
  fs::create_directories(restart_directory(run_));
  const std::string name = fmt::format("dump-{:012}", steps);
  files::DumpWriter dump(restart_directory(run_) / (name + ".h5"));
  fill(name, dump);
  dump.close();
  const std::vector<fs::path> all = dumps_of(run_);
  for (std::size_t i = kKept; i < all.size(); ++i) fs::remove(all[i]);
  last_ = std::chrono::steady_clock::now();
}

void RestartDumps::note_end() const {
  if (fs::exists(restart_directory(run_))) std::ofstream(end_note(run_)).flush();
}

// Deletes the dumps before the note of the end: a kill in between leaves nothing that looks like a run to be continued.
void RestartDumps::remove() const {
  for (const fs::path& dump : dumps_of(run_)) fs::remove(dump);
  fs::remove_all(restart_directory(run_));
}

}  // namespace shearbus::hydro
