#include "server/service/own_laws.hpp"

#include <functional>
#include <map>
#include <utility>

namespace shearbus::service {
namespace {

std::map<std::string, const shearbus_friction_law*, std::less<>>& laws() {
  static std::map<std::string, const shearbus_friction_law*, std::less<>> all;
  return all;
}

}  // namespace

void offer_own_law(std::string name, const shearbus_friction_law* law) {
  laws()[std::move(name)] = law;
}

const shearbus_friction_law* own_law(std::string_view name) {
  const auto found = laws().find(name);
  return found == laws().end() ? nullptr : found->second;
}

std::vector<std::string> own_law_names() {
  std::vector<std::string> names;
  for (const auto& [name, law] : laws()) names.push_back(name);
  return names;
}

}  // namespace shearbus::service
