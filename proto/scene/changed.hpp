// A scene's text with keys changed by a command line, and faults of it at the places that its user knows.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "proto/scene/rules.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::scene {

class ChangedScene {
 public:
  ChangedScene() = default;
  // `file`: the name under which the text is read. `changes`: "table.key=value" of each --set; of the last one, if
  // `swept`, of --sweep. Throws as with_value().
  ChangedScene(const std::string& text, std::string file, std::span<const std::string> changes, bool swept = false);

  const std::string& text() const { return text_; }
  const std::vector<std::string>& changes() const { return changes_; }

  // A sentence for each change of a table that pairs have another of: it does not reach their nodes.
  std::vector<std::string> kept_by_pairs() const;

  // Returns the status with each place "FILE:line:column" of the changed text replaced: by "--set KEY=VALUE" (--sweep)
  // where that set the key, else by the key's place in the text before the changes.
  wire::Status placed(wire::Status status) const;

 private:
  std::string placed(const std::string& line) const;
  const char* option_of(const std::string& change) const;

  std::string text_, file_;
  std::vector<std::string> changes_;
  bool swept_ = false;
  std::map<std::string, Place> places_;         // of each key in the text before the changes
  std::map<std::uint32_t, std::string> paths_;  // the key of each line of the changed text
};

}  // namespace shearbus::scene
