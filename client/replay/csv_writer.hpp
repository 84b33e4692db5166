// Tables of steps and nodes as CSV, which csv.cpp reads as a history.
#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/replay/node_properties.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/wire/messages.hpp"

namespace shearbus::replay {

using ColumnPlace = std::pair<wire::Field, std::uint32_t>;  // a component of a column

// The ending of a file's name in small letters, such as ".csv".
std::string ending_of(const std::filesystem::path& file);

// Whether a result of this name is written as CSV: it ends in .csv or .tsv, with tabs between the values.
bool is_text_result(const std::filesystem::path& file);

// Throws Error for a name whose ending stands for a table of text when it is read, but is no ending of a result.
void refuse_ending_of_text(const std::filesystem::path& file);

class CsvWriter {
 public:
  // `properties`: of the nodes, one value each; they are repeated in each row. `like`: a name whose ending tells how to
  // write, if that of `file` does not.
  CsvWriter(const std::filesystem::path& file, const std::filesystem::path& like, std::vector<ColumnPlace> columns,
            std::span<const std::uint64_t> node_ids, const NodeProperties& properties);

  // Writes the rows of a step; `values`: of each column, in the order of the nodes.
  void step(double time_s, double dt_s, std::span<const std::vector<double>> values);
  void close();  // returns when the file is on the disk under its final name
  bool replaces() const { return partial_.replaces(); }

 private:
  files::PartialFile partial_;
  std::vector<ColumnPlace> columns_;
  std::vector<std::uint64_t> node_ids_;
  NodeProperties properties_;
  char separator_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
};

}  // namespace shearbus::replay
