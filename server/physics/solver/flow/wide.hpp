// Kernels over lanes or vertices are compiled twice, the wider version taken where the machine has the registers. Every
// value is computed by the same products and sums in the same order either way (none fused: contraction is off), so its
// bits are the same; tests/unit/physics_bits.cpp holds them. Sanitizers start too late for functions chosen at load
// time. All that a kernel calls is put into it (flatten): a call left in a loop over lanes, as the compiler leaves them
// in long kernels, is one value at a time.
#pragma once

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define SHEARBUS_WIDE [[gnu::flatten, gnu::target_clones("avx2", "default")]]
#else
#define SHEARBUS_WIDE
#endif
