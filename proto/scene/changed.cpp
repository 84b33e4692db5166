#include "proto/scene/changed.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <charconv>
#include <functional>
#include <set>
#include <system_error>
#include <utility>

#include "proto/scene/reader.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::scene {
namespace {

using Visit = std::function<void(const std::string& path, const Place& place)>;

void visit_keys(const toml::table& table, const std::string& above, const Visit& visit) {
  for (const auto& [key, node] : table) {
    const std::string path = above.empty() ? std::string(key.str()) : fmt::format("{}.{}", above, key.str());
    const toml::source_position at =
        node.is_table() && node.source().begin.line > 0 ? node.source().begin : key.source().begin;
    visit(path, {at.line, at.column});
    if (const toml::table* inner = node.as_table()) visit_keys(*inner, path, visit);
  }
}

void visit_keys_of(const std::string& text, const Visit& visit) {
  try {
    visit_keys(toml::parse(text), "", visit);
  } catch (const toml::parse_error&) {  // it is refused where it is read
  }
}

}  // namespace

ChangedScene::ChangedScene(const std::string& text, std::string file, std::span<const std::string> changes, bool swept)
    : text_(text), file_(std::move(file)), changes_(changes.begin(), changes.end()), swept_(swept) {
  if (changes_.empty()) return;
  for (const std::string& change : changes_) text_ = with_value(text_, option_of(change), change);
  visit_keys_of(text, [&](const std::string& path, const Place& place) { places_.emplace(path, place); });
  visit_keys_of(text_, [&](const std::string& path, const Place& place) { paths_.emplace(place.line, path); });
}

std::vector<std::string> ChangedScene::kept_by_pairs() const {
  std::vector<std::string> sentences;
  for (const std::string& change : changes_) {
    const std::string table = change.substr(0, change.find_first_of(".="));
    std::set<std::string> pairs;
    for (const auto& [path, place] : places_)
      if (const std::size_t at = path.find('.' + table + '.'); path.starts_with("pair.") && at != std::string::npos)
        pairs.insert(path.substr(0, at));
    for (const std::string& pair : pairs)
      sentences.push_back(fmt::format(
          "{} {} does not reach the nodes of [{}], which has a table [{}] of its own; {}.{} does", option_of(change),
          wire::printable(change, wire::kMaxTextBytes), pair, table, pair, change.substr(0, change.find('='))));
  }
  return sentences;
}

const char* ChangedScene::option_of(const std::string& change) const {
  return swept_ && &change == &changes_.back() ? "--sweep" : "--set";
}

std::string ChangedScene::placed(const std::string& line) const {
  const std::string begin = file_ + ":";
  if (!line.starts_with(begin)) return line;
  Place at;
  const char* const last = line.data() + line.size();
  const auto [colon, fault] = std::from_chars(line.data() + begin.size(), last, at.line);
  if (fault != std::errc() || colon == last || *colon != ':') return line;
  const auto [end, other_fault] = std::from_chars(colon + 1, last, at.column);
  if (other_fault != std::errc()) return line;
  const std::string rest(end, last);  // ": text"
  const auto path = paths_.find(at.line);
  if (path == paths_.end()) return file_ + rest;
  for (const std::string& change : changes_)
    if (change.substr(0, change.find('=')) == path->second)
      return fmt::format("{} {}{}", option_of(change), wire::printable(change, wire::kMaxTextBytes), rest);
  const auto place = places_.find(path->second);
  return place == places_.end() ? file_ + rest
                                : fmt::format("{}:{}:{}{}", file_, place->second.line, place->second.column, rest);
}

wire::Status ChangedScene::placed(wire::Status status) const {
  if (changes_.empty() || status.code != wire::Code::kInvalidScene) return status;
  std::string text;
  for (std::size_t at = 0; at <= status.text.size();) {
    const std::size_t end = std::min(status.text.find('\n', at), status.text.size());
    if (at > 0) text += '\n';
    text += placed(status.text.substr(at, end - at));
    at = end + 1;
  }
  status.text = std::move(text);
  return status;
}

}  // namespace shearbus::scene
