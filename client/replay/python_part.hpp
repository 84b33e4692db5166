// The part of this program that is in Python: tables of text, comparisons of tables, pictures.
#pragma once

#include <exception>
#include <filesystem>
#include <string>

#include "proto/files/recording.hpp"

namespace shearbus::replay {

// Thrown where Python has told the user why it ended.
class Told final : public std::exception {};

// Reads a table of text as a history, by way of a file in HDF5 that Python makes of it. Throws Told for a table that is
// refused.
files::HistoryReader read_text(const std::filesystem::path& file, const std::string& columns, bool points);

}  // namespace shearbus::replay
