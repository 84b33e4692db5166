#include "client/src/shards.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <set>
#include <string_view>
#include <utility>

#include "proto/files/endpoint_file.hpp"
#include "proto/wire/status.hpp"

namespace shearbus {
namespace {

using wire::Code;
using wire::Error;

constexpr std::array<std::string_view, 4> kSchemes = {"tcp://", "ipc://", "inproc://", files::kFileScheme};

[[noreturn]] void refuse(std::string text, std::string remedy) {
  throw Error({.code = Code::kInvalidValue, .text = std::move(text), .remedy = std::move(remedy), .field = "endpoint"});
}

// Position of the next comma, from `at` on, that separates two endpoints; a comma within a path does not.
std::size_t next_separator(std::string_view text, std::size_t at) {
  while ((at = text.find(',', at)) != std::string_view::npos) {
    const std::size_t next = text.find_first_not_of(", ", at + 1);
    const auto begins = [&](std::string_view scheme) { return text.substr(next).starts_with(scheme); };
    if (next == std::string_view::npos || std::ranges::any_of(kSchemes, begins)) break;
    ++at;
  }
  return std::min(at, text.size());
}

void add(std::string endpoint, std::vector<std::string>& to) {
  if (!endpoint.starts_with(files::kFileScheme)) return to.push_back(std::move(endpoint));
  const std::filesystem::path path = endpoint.substr(files::kFileScheme.size());
  std::error_code no_directory;
  if (!std::filesystem::is_directory(path, no_directory)) return to.push_back(std::move(endpoint));
  try {
    for (const auto& file : files::endpoint_files(path)) to.push_back(std::string(files::kFileScheme) + file.string());
  } catch (const std::runtime_error& fault) {
    refuse(fault.what(),
           "Start all servers of the run with --endpoint-file, and wait for each of them: "
           "shearbus-ctl wait --server file://FILE.");
  }
}

// The mixing function of SplitMix64.
constexpr std::uint64_t mixed(std::uint64_t x) {
  x = (x ^ (x >> 30U)) * 0xbf58476d1ce4e5b9U;
  x = (x ^ (x >> 27U)) * 0x94d049bb133111ebU;
  return x ^ (x >> 31U);
}

}  // namespace

std::vector<std::string> endpoints_in(const std::string& text) {
  std::vector<std::string> found;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = next_separator(text, at);
    const std::size_t first = std::min(text.find_first_not_of(' ', at), end);
    if (first == end && !(at == 0 && end == text.size()))
      refuse(fmt::format("the list of endpoints \"{}\" has an empty endpoint", text),
             "Give the endpoint of each server once, with one comma between two of them.");
    const std::size_t behind = first == end ? end : text.find_last_not_of(' ', end - 1) + 1;
    add(text.substr(first, behind - first), found);
    at = end + 1;
  }
  std::set<std::string> distinct;
  for (const std::string& endpoint : found)
    if (!distinct.insert(endpoint).second)
      refuse(fmt::format("the endpoint {} is named twice", endpoint), "Give the endpoint of each server once.");
  return found;
}

std::uint32_t shard_of(std::uint64_t node_id, std::uint32_t shards) {
  constexpr std::uint64_t kIncrement = 0x9e3779b97f4a7c15U;
  const std::uint64_t seed = mixed(node_id);
  std::uint32_t best = 0;
  std::uint64_t highest = 0;
  for (std::uint32_t shard = 0; shard < shards; ++shard) {
    const std::uint64_t score = mixed(seed + (shard + std::uint64_t{1}) * kIncrement);
    if (score < highest) continue;
    highest = score;
    best = shard;
  }
  return best;
}

wire::SessionId session_of_shard(const wire::SessionId& session, std::uint32_t shard, std::uint32_t shards) {
  wire::SessionId id = session;
  const std::uint64_t mask = mixed((std::uint64_t{shards} << 32U) + shard + 1);
  for (unsigned i = 0; i < 8; ++i) id[i] ^= static_cast<std::uint8_t>(mask >> (8 * i));
  return id;
}

std::string domain_of_shard(const std::string& domain, std::uint32_t shard, std::uint32_t shards) {
  return fmt::format("{}#{}/{}", domain, shard, shards);
}

}  // namespace shearbus
