#include "client/replay/plot.hpp"

#include <fmt/format.h>

#include <optional>
#include <utility>

#include "client/replay/log_export.hpp"
#include "client/replay/python_part.hpp"
#include "proto/files/event_log.hpp"
#include "proto/files/input_file.hpp"
#include "proto/files/recording.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/program/program.hpp"
#include "proto/program/python.hpp"

namespace shearbus::replay {
namespace {

namespace fs = std::filesystem;

constexpr files::FileKind kPictureFile = {
    "a picture (PNG)", [](const fs::path& file) { return files::head_of(file, 8) == "\x89PNG\r\n\x1a\n"; }};

}  // namespace

void plot(const PlotOptions& options) {
  std::vector<std::string> words = {program::script("report", "plot_history.py"), "--out", options.out.string()};
  if (options.node) words.insert(words.end(), {"--node", std::to_string(*options.node)});
  std::vector<files::InputFile> inputs;
  for (const fs::path& file : options.files) {
    const files::RegularFile regular(file);  // a pipe is refused, which would keep the program waiting
    inputs.push_back({"an input", file});
  }
  files::refuse_inputs_as_output("--out", options.out, inputs);
  files::check_output(options.out, kPictureFile);
  std::optional<files::PartialFile> exported;  // the table of an event log, which is not published
  for (const fs::path& file : options.files) {
    if (!files::is_event_log(file)) {
      words.push_back(file.string());
      continue;
    }
    exported.emplace(options.out.string() + ".h5", files::kHistoryFile, files::PartialFile::Writers::kAny);
    export_log(
        {.log = file, .out = exported->path(), .node = options.node, .after_mark = {}, .final_name = exported->file()});
    words.push_back(exported->path().string());
  }
  if (!program::run_python(std::move(words))) throw Told();
  fmt::print("{}\n", program::shown(options.out));
}

}  // namespace shearbus::replay
