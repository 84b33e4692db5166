// Kernels of conduction (conduction.hpp, modes.hpp), for all lanes of a tile or, in the namespace `one`, for one lane.
// each_register.hpp includes this file once per register width.

// The vertices of one body, without z = 0.
struct Arm {
  // Outermost vertex that is not at the far temperature (that of the colder end) in every lane; z = 0 if none.
  std::ptrdiff_t heated;
  std::ptrdiff_t outermost;  // outermost vertex of the body
  std::ptrdiff_t outwards;   // step to the next outer vertex: 1 or -1
};

struct Row {
  Register part[kParts];
};

[[gnu::always_inline]] inline Row row_at(const double* rows, std::ptrdiff_t i) {
  Row row;
  SHEARBUS_EACH_PART row.part[p] = load(rows + i * kLanes + p * kWidth);
  return row;
}

// Eliminates from the outermost heated vertex inwards to the neighbour of z = 0. Vertices farther out are at the
// temperature `far` and contribute nothing.
[[gnu::always_inline]] inline Row eliminate(const HeatOperator& heat, Arm arm, const Row& far, const double* before,
                                            double* after) {
  const double* inverse_pivot = heat.inverse_pivot.data();
  const double* inward = heat.inward.data();
  const std::ptrdiff_t end = heat.interface;
  Row t{};
#pragma GCC unroll 4
  for (std::ptrdiff_t i = arm.heated; i != end; i -= arm.outwards) {
    const Register own = all(inverse_pivot[i]), outer = all(inward[i]);
    SHEARBUS_EACH_PART {
      t.part[p] = (load(before + i * kLanes + p * kWidth) - far.part[p]) * own + outer * t.part[p];
      store(t.part[p], after + i * kLanes + p * kWidth);
    }
  }
  return t;
}

// Substitutes outwards from z = 0, where the temperature above `far` is `t`. Beyond the heated vertices this value
// decays; from the vertex on where it no longer changes the temperature of any lane the vertices stay at `far`.
// kAhead: the rows of the next tile, `next` doubles farther, are asked for on the way. A chain of dependent products
// leaves the memory idle here; asked for all at once they would wait for each other.
template <bool kAhead>
[[gnu::always_inline]] inline void substitute(const HeatOperator& heat, Arm arm, const Row& far, Row t,
                                              const double* before, double* after, std::ptrdiff_t next) {
  const double* outward = heat.outward.data();
  std::ptrdiff_t i = heat.interface;
#pragma GCC unroll 4
  while (i != arm.heated) {
    i += arm.outwards;
    const Register inner = all(outward[i]);
    if constexpr (kAhead) {
      __builtin_prefetch(before + i * kLanes + next);
      __builtin_prefetch(after + i * kLanes + next, 1);
    }
    SHEARBUS_EACH_PART {
      double* T = after + i * kLanes + p * kWidth;
      t.part[p] = load(T) + inner * t.part[p];
      store(far.part[p] + t.part[p], T);
    }
  }
  for (bool felt = true; i != arm.outermost;) {
    i += arm.outwards;
    if (felt) {
      Mask changed{};
      SHEARBUS_EACH_PART {
        t.part[p] *= outward[i];
        changed |= far.part[p] + t.part[p] != far.part[p];
      }
      felt = lanes_where(changed) != 0;
    }
    SHEARBUS_EACH_PART store(felt ? far.part[p] + t.part[p] : far.part[p], after + i * kLanes + p * kWidth);
  }
}

// The elimination and substitution of a step without heat flux, from `before` to `after`, which may be the same array.
// They work on the temperature above `far`, the temperature of the colder end, so that a uniform layer stays uniform to
// the last bit and rounding cools no vertex below the coldest one. `next`: distance to the rows of the next tile in
// memory; 0: unknown.
inline void sweep(const HeatOperator& heat, int num_vertices, const double* before, double* after,
                  std::ptrdiff_t next) {
  const std::ptrdiff_t interface = heat.interface;
  const std::ptrdiff_t last = num_vertices - 1;
  Row far;
  SHEARBUS_EACH_PART far.part[p] = smaller(load(before + p * kWidth), load(before + last * kLanes + p * kWidth));

  // 1. Find how far heat has come. Memory is asked for in ascending addresses first: reading inwards from the far ends
  // is a quarter slower when the states exceed the cache, and so is waiting for the rows that are written.
#pragma GCC unroll 4
  for (std::ptrdiff_t i = 0; i <= last; ++i) {
    __builtin_prefetch(before + i * kLanes);
    __builtin_prefetch(after + i * kLanes, 1);
  }
  const auto cold = [&](std::ptrdiff_t i) __attribute__((always_inline)) {
    Mask warmer{};
    SHEARBUS_EACH_PART warmer |= load(before + i * kLanes + p * kWidth) != far.part[p];
    return lanes_where(warmer) == 0;
  };
  Arm soft{last, last, 1}, hard{0, 0, -1};
  while (soft.heated > interface && cold(soft.heated)) --soft.heated;
  while (hard.heated < interface && cold(hard.heated)) ++hard.heated;

  // 2. Sweep over the heated vertices only, which gives the same bits as a sweep over all vertices.
  const Row from_soft = eliminate(heat, soft, far, before, after);
  const Row from_hard = eliminate(heat, hard, far, before, after);
  Row t = row_at(before, interface);
  const double inverse_pivot = heat.inverse_pivot[interface], inward = heat.inward[interface];
  SHEARBUS_EACH_PART {
    t.part[p] =
        (t.part[p] - far.part[p]) * inverse_pivot + inward * from_soft.part[p] + heat.inward_hard * from_hard.part[p];
    store(far.part[p] + t.part[p], after + interface * kLanes + p * kWidth);
  }
  if (next != 0) {
    substitute<true>(heat, soft, far, t, before, after, next);
    substitute<true>(heat, hard, far, t, before, after, next);
  } else {
    substitute<false>(heat, soft, far, t, before, after, next);
    substitute<false>(heat, hard, far, t, before, after, next);
  }
}

inline void respond(const HeatOperator& heat, std::span<const double> gain, const double* shape, double* response) {
  const double* inverse_pivot = heat.inverse_pivot.data() + heat.interface;
  const double* inward = heat.inward.data() + heat.interface;
  const double* outward = heat.outward.data() + heat.interface;
  Row t{};
  for (std::ptrdiff_t i = std::ssize(gain); i-- > 0;) {
    const double rise = gain[static_cast<std::size_t>(i)] * inverse_pivot[i];
    SHEARBUS_EACH_PART {
      t.part[p] = load(shape + i * kLanes + p * kWidth) * rise + inward[i] * t.part[p];
      store(t.part[p], response + i * kLanes + p * kWidth);
    }
  }
  for (std::ptrdiff_t i = 1; i < std::ssize(gain); ++i) {
    SHEARBUS_EACH_PART {
      t.part[p] = load(response + i * kLanes + p * kWidth) + outward[i] * t.part[p];
      store(t.part[p], response + i * kLanes + p * kWidth);
    }
  }
}

[[gnu::always_inline]] inline void scale(Row& row, double factor) {
  SHEARBUS_EACH_PART row.part[p] *= factor;
}
[[gnu::always_inline]] inline void add_to(double* lanes, const Row& row) {
  SHEARBUS_EACH_PART store(load(lanes + p * kWidth) + row.part[p], lanes + p * kWidth);
}

inline void add_spread(const HeatOperator& heat, std::ptrdiff_t layer_vertices, const double* flux,
                       const double* response, double* temperature) {
  const std::ptrdiff_t interface = heat.interface;
  const std::ptrdiff_t end = interface + layer_vertices;
  const Row q = row_at(flux, 0);
  Row t;
  SHEARBUS_EACH_PART t.part[p] = q.part[p] * load(response + p * kWidth);
  for (std::ptrdiff_t i = interface; i-- > 0;) {
    scale(t, heat.outward[i]);
    add_to(temperature + i * kLanes, t);
  }
  for (std::ptrdiff_t i = interface; i < end; ++i) {
    SHEARBUS_EACH_PART t.part[p] = q.part[p] * load(response + (i - interface) * kLanes + p * kWidth);
    add_to(temperature + i * kLanes, t);
  }
  for (std::ptrdiff_t i = end; i < std::ssize(heat.outward); ++i) {
    scale(t, heat.outward[i]);
    add_to(temperature + i * kLanes, t);
  }
}

#if SHEARBUS_WIDTH > 1

inline void add_rows(std::span<const double> gain, const double* flux, double* rows) {
  const Row q = row_at(flux, 0);
#pragma GCC unroll 4
  for (std::ptrdiff_t i = 0; i < std::ssize(gain); ++i) {
    const Register rise = all(gain[i]);
    SHEARBUS_EACH_PART {
      double* T = rows + i * kLanes + p * kWidth;
      store(load(T) + q.part[p] * rise, T);
    }
  }
}

inline void decay_rows(std::span<const double> decay, const double* before, double* after, double* sum) {
  Row total = row_at(sum, 0);
#pragma GCC unroll 4
  for (std::ptrdiff_t i = 0; i < std::ssize(decay); ++i) {
    const Register kept = all(decay[i]);
    SHEARBUS_EACH_PART {
      const Register mode = load(before + i * kLanes + p * kWidth) * kept;
      store(mode, after + i * kLanes + p * kWidth);
      total.part[p] += mode;
    }
  }
  SHEARBUS_EACH_PART store(total.part[p], sum + p * kWidth);
}

inline void extrapolate(std::ptrdiff_t num_rows, double factor, const double* before, double* rows) {
  for (std::ptrdiff_t i = 0; i < num_rows * kLanes; i += kWidth) {
    const Register old = load(before + i);
    store(old + factor * (load(rows + i) - old), rows + i);
  }
}

inline void find_range(std::ptrdiff_t num_rows, const double* rows, double* lowest, double* highest) {
  Row low = row_at(rows, 0), high = low;
  for (std::ptrdiff_t i = 1; i < num_rows; ++i) {
    SHEARBUS_EACH_PART {
      const Register T = load(rows + i * kLanes + p * kWidth);
      low.part[p] = smaller(T, low.part[p]);
      high.part[p] = where(high.part[p] < T, T, high.part[p]);
    }
  }
  SHEARBUS_EACH_PART {
    store(low.part[p], lowest + p * kWidth);
    store(high.part[p], highest + p * kWidth);
  }
}

inline std::uint32_t find_below(std::span<const double> gain, const double* flux, const double* bound,
                                const double* rows) {
  const Row q = row_at(flux, 0), end = row_at(bound, 0);
  std::uint32_t lanes = 0;
  SHEARBUS_EACH_PART {
    Mask below = without(Mask{});
    for (std::ptrdiff_t i = 0; i < std::ssize(gain); ++i) {
      below &= load(rows + i * kLanes + p * kWidth) + q.part[p] * all(gain[i]) < end.part[p];
    }
    lanes |= lanes_where(below) << p * kWidth;
  }
  return lanes;
}

#endif
