// The headers that most tests include, parsed once for all test programs of a build with SHEARBUS_UNITY. A source still
// includes what it uses: other builds have no precompiled header.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "tests/support/durable_server.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/service_harness.hpp"
