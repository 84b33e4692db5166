// With gcc on x86-64, SHEARBUS_WIDE compiles a kernel twice; the loader chooses the AVX2 version where the machine has
// AVX2. Both versions compute every value by the same operations in the same order (contraction is off), so the bits
// are the same; tests/unit/physics_bits.cpp checks them. Sanitizers initialise too late for functions chosen by the
// loader. `flatten` inlines every call: a call that remains in a loop over lanes prevents vectorisation.
#pragma once

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define SHEARBUS_WIDE [[gnu::flatten, gnu::target_clones("avx2", "default")]]
#else
#define SHEARBUS_WIDE
#endif
