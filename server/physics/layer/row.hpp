// A row: the values of all lanes of a tile in registers of SHEARBUS_WIDTH doubles. A row of one double is that of one
// lane, to which pointers to rows point. each_register.hpp includes this file once per width; so it has no include guard.

inline constexpr int kParts = SHEARBUS_WIDTH > 1 ? kLanes / SHEARBUS_WIDTH : 1;  // number of registers of a row

#define SHEARBUS_EACH_PART _Pragma("GCC unroll 4") for (std::ptrdiff_t p = 0; p < kParts; ++p)
