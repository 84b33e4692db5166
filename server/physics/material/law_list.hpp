// A list of classes: the one place where the laws of a kind (flow, friction) are registered. At run time a law is
// identified by its place in the list.
#pragma once

#include <cstddef>
#include <optional>
#include <string_view>
#include <type_traits>
#include <utility>

namespace shearbus::physics {

template <class Law>
struct LawType {
  using type = Law;
};

template <class Place, class... Laws>
class LawList {
 public:
  template <class Law>
  static constexpr Place place() {
    std::size_t at = 0;
    (void)((std::is_same_v<Law, Laws> || (++at, false)) || ...);
    return static_cast<Place>(at);
  }

  // Calls f(LawType<Law>{}) with the law at `place` of the list. Callers choose the law once, outside their loops.
  template <class F>
  [[gnu::always_inline]] static decltype(auto) with(Place place, F&& f) {
    return choose<F, Laws...>(static_cast<std::size_t>(place), std::forward<F>(f));
  }

  // Whether f(LawType<Law>{}) is true for at least one law of the list.
  template <class F>
  static constexpr bool any(F&& f) {
    return (f(LawType<Laws>{}) || ...);
  }

  static std::string_view name_of(Place place) {
    return with(place, [](auto law) { return decltype(law)::type::kName; });
  }

  // The law with this number in a scene's enum; empty for 0 (no law chosen) and for unknown numbers.
  static std::optional<Place> numbered(int number) {
    if (number <= 0 || number > static_cast<int>(sizeof...(Laws))) return {};
    return static_cast<Place>(number - 1);
  }

 private:
  template <class F, class First, class... Rest>
  [[gnu::always_inline]] static decltype(auto) choose(std::size_t place, F&& f) {
    if constexpr (sizeof...(Rest) == 0) {
      return f(LawType<First>{});
    } else {
      if (place == 0) return f(LawType<First>{});
      return choose<F, Rest...>(place - 1, std::forward<F>(f));
    }
  }
};

}  // namespace shearbus::physics
