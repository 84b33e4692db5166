#include "client/src/c_calls.hpp"

#include <new>

namespace shearbus {
namespace {

// Copies a text. Of a text that is too long it copies the beginning, cut between two UTF-8 characters, and adds "...".
// Allocates no memory.
template <std::size_t kSize>
void put(std::string_view text, char (&to)[kSize]) noexcept {
  constexpr std::string_view kCut = "...";
  std::size_t length = text.size();
  if (length >= kSize) {
    length = kSize - 1 - kCut.size();
    while (length > 0 && (static_cast<unsigned char>(text[length]) & 0xC0U) == 0x80U) --length;
  }
  text.copy(to, length);  // also of no characters at no address
  if (length < text.size()) {
    length += kCut.copy(to + length, kCut.size());
  }
  to[length] = '\0';
}

thread_local std::string last_text;

void keep_text(std::string_view text) noexcept try { last_text = text; } catch (const std::bad_alloc&) {
  last_text.clear();
}

}  // namespace

int report(shearbus_status* to, int code, std::string_view text, std::string_view remedy, std::string_view field,
           std::span<const std::uint64_t> nodes) noexcept {
  if (code != SHEARBUS_OK) keep_text(text);
  if (to == nullptr) return code;
  to->code = code;
  put(text, to->text);
  put(remedy, to->remedy);
  put(field, to->field);
  to->n_nodes = 0;
  for (const std::uint64_t node : nodes.first(std::min<std::size_t>(nodes.size(), SHEARBUS_NODES_NAMED)))
    to->nodes[to->n_nodes++] = node;
  return code;
}

int report_caught(shearbus_status* to) noexcept {
  try {
    throw;
  } catch (const Error& fault) {
    const Status& found = fault.status();
    const bool of_text = found.remedy.empty() && found.code == Code::kInvalidScene;  // a list of places says it itself
    return report(
        to, static_cast<int>(found.code), found.text,
        of_text ? "Correct the scene there; shearbus-ctl check SCENE tells whether it is valid." : found.remedy,
        found.field, found.node_ids);
  } catch (const std::bad_alloc&) {
    return report(to, SHEARBUS_NO_MEMORY, "the host's process has no memory left",
                  "Free memory and make the same call again: if it has run, it is not run a second time.");
  } catch (const std::exception& fault) {
    return report(to, SHEARBUS_LIBRARY_FAULT, fault.what(),
                  "Make the same call again: if it has run, it is not run a second time.");
  } catch (...) {
    return report(to, SHEARBUS_LIBRARY_FAULT, "an unknown fault inside the client library");
  }
}

}  // namespace shearbus

const char* shearbus_fault_text(void) {
  return shearbus::last_text.c_str();
}
