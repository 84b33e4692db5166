// The functions of checkpoint.hpp in libshearbus-embedded.so. Each calls its namesake in libshearbus-checkpoint.so in
// the same directory, which the first call loads.
#include <dlfcn.h>

#include <filesystem>
#include <stdexcept>

#include "server/store/checkpoint_library.hpp"

namespace shearbus::store {
namespace {

const CheckpointLibrary& load() {
  constexpr const char* kLibrary = "libshearbus-checkpoint.so.1";
  std::string file = kLibrary;
  Dl_info self{};
  if (::dladdr(reinterpret_cast<void*>(&load), &self) != 0 && self.dli_fname != nullptr)
    file = (std::filesystem::path(self.dli_fname).parent_path() / kLibrary).string();
  void* library = ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
  const void* symbol = library == nullptr ? nullptr : ::dlsym(library, "shearbus_checkpoint_1");
  if (symbol == nullptr) throw std::runtime_error(::dlerror());
  const auto& table = *static_cast<const CheckpointLibrary*>(symbol);
  if (const std::string fault = table.fault(); !fault.empty()) throw std::runtime_error(fault);
  return table;
}

}  // namespace

const CheckpointLibrary& checkpoint_library() {
  static const CheckpointLibrary& loaded = load();
  return loaded;
}

std::vector<std::byte> checkpoint_bytes(const Snapshot& snapshot, std::uint64_t generation) {
  return checkpoint_library().checkpoint_bytes(snapshot, generation);
}
Bytes verified_image(Bytes file, const std::string& name, std::uint64_t generation) {
  return checkpoint_library().verified_image(file, name, generation);
}
std::vector<std::byte> capsule_bytes(const Capsule& capsule) {
  return checkpoint_library().capsule_bytes(capsule);
}
Capsule read_capsule(Bytes file, const std::string& name) {
  return checkpoint_library().read_capsule(file, name);
}
Snapshot read_checkpoint(Bytes file, const std::string& name, std::uint64_t generation) {
  return checkpoint_library().read_checkpoint(file, name, generation);
}

}  // namespace shearbus::store
