#include "server/own_laws.hpp"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <string_view>

#include "proto/wire/status.hpp"
#include "server/service/own_laws.hpp"

namespace shearbus::server {
namespace {

constexpr const char* kSymbol = "shearbus_friction_law_of_library";

[[noreturn]] void refuse(const std::string& given, std::string_view fault, std::string_view remedy) {
  throw wire::Error({.code = wire::Code::kInvalidValue,
                     .text = fmt::format("--friction-law {}: {}", given, fault),
                     .remedy = std::string(remedy),
                     .field = "friction_law"});
}

bool declares(int change) {
  return change == SHEARBUS_FALLS || change == SHEARBUS_CONSTANT || change == SHEARBUS_RISES;
}

// What is wrong with a law; empty: nothing.
std::string fault_of(const shearbus_friction_law& law) {
  if (law.version != SHEARBUS_FRICTION_LAW_VERSION)
    return fmt::format("its law has version {}, expected {}", law.version, SHEARBUS_FRICTION_LAW_VERSION);
  if (law.num_states > SHEARBUS_FRICTION_LAW_STATES)
    return fmt::format("its law has {} states, at most {} are kept", law.num_states, SHEARBUS_FRICTION_LAW_STATES);
  if (!declares(law.with_slip) || !declares(law.through_states))
    return "with_slip and through_states must be SHEARBUS_FALLS, SHEARBUS_CONSTANT or SHEARBUS_RISES";
  if (law.limit == nullptr) return "its law has no limit()";
  if (law.num_states > 0 && law.advance == nullptr) return "its law has states and no advance()";
  return {};
}

}  // namespace

OwnLaw own_law_of(const std::string& given) {
  const std::size_t equals = given.find('=');
  OwnLaw law{given.substr(0, equals), equals == given.npos ? "" : given.substr(equals + 1)};
  const auto fits = [](unsigned char c) { return std::isalnum(c) != 0 || c == '_' || c == '-' || c == '.'; };
  if (law.name.empty() || law.file.empty() || !std::all_of(law.name.begin(), law.name.end(), fits))
    refuse(given, "expected NAME=FILE, with a name of letters, digits, '_', '-' and '.'",
           "For example --friction-law fault_gouge=/usr/lib/shearbus/fault_gouge.so.");
  return law;
}

void load_own_laws(const std::vector<std::string>& laws) {
  for (const std::string& given : laws) {
    const auto [name, file] = own_law_of(given);
    void* const library = ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);  // never closed: sessions use it to the end
    if (library == nullptr) {
      const char* const fault = ::dlerror();
      refuse(given, fault != nullptr ? fault : "it cannot be loaded",
             "Give the path of a shared library of this machine.");
    }
    const auto* const law = static_cast<const shearbus_friction_law*>(::dlsym(library, kSymbol));
    if (law == nullptr)
      refuse(given, fmt::format("the library has no symbol {}", kSymbol),
             "Define it as shearbus/friction_law.h says; in C++ with extern \"C\".");
    if (const std::string fault = fault_of(*law); !fault.empty())
      refuse(given, fault, "Compile the law with the friction_law.h of this version.");
    if (service::own_laws().emplace(name, law).first->second != law)
      refuse(given, "another law has that name", "Give each law a name of its own.");
  }
}

}  // namespace shearbus::server
