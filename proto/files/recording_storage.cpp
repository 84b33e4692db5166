#include "proto/files/recording_storage.hpp"

#include <fmt/format.h>

#include <array>
#include <cstddef>
#include <vector>

#include "proto/files/hdf5.hpp"
#include "proto/wire/numbers.hpp"

namespace shearbus::files::hdf5 {
namespace {

using namespace shearbus::hdf5;  // NOLINT(google-build-using-namespace)

constexpr std::size_t kMostChunkBytes = 256ull << 20;
constexpr int kMostLinks = 16;  // soft links that lead to each other

// As fault_of_link(); `links`: soft links followed so far.
std::string fault_of_path(hid_t file, const std::string& path, int links) {
  for (std::size_t end = path.find('/', 1);; end = path.find('/', end + 1)) {
    const std::string part = path.substr(0, end);
    H5L_info_t link{};
    if (H5Lget_info(file, part.c_str(), &link, H5P_DEFAULT) < 0) return {};  // no such object: found when it is opened
    if (link.type == H5L_TYPE_SOFT) {
      if (links == kMostLinks) return "is behind too many links";
      std::vector<char> value(link.u.val_size + 1, '\0');
      if (H5Lget_val(file, part.c_str(), value.data(), value.size(), H5P_DEFAULT) < 0) return "is a link to nothing";
      std::string to = value.data();
      if (!to.starts_with('/'))
        if (const auto slash = part.rfind('/'); slash != std::string::npos) to = part.substr(0, slash + 1) + to;
      if (std::string fault = fault_of_path(file, to, links + 1); !fault.empty()) return fault;
    } else if (link.type != H5L_TYPE_HARD) {
      return "is a link to another file, which is not read";
    }
    if (end == std::string::npos) return {};
  }
}

// The number of chunks that an array of this shape has.
hsize_t chunks_of(const Shape& shape, const Shape& chunk) {
  hsize_t count = 1;
  for (std::size_t i = 0; i < shape.size(); ++i) count *= (shape[i] + chunk[i] - 1) / chunk[i];
  return count;
}

StorageFault fault_of_filters(hid_t creation) {
  const int filters = H5Pget_nfilters(creation);
  for (int i = 0; i < filters; ++i) {
    std::array<char, 64> name{};
    std::size_t values = 0;
    unsigned flags = 0;
    const H5Z_filter_t filter = H5Pget_filter2(creation, static_cast<unsigned>(i), &flags, &values, nullptr,
                                               name.size() - 1, name.data(), nullptr);
    if (filter < 0 || H5Zfilter_avail(filter) > 0) continue;
    const std::string named = filter == 32000 ? "LZF, which h5py alone has" : wire::in_quotes(name.data());
    return {.fault = fmt::format("is packed by a filter that is not installed here: {} (number {})", named, filter),
            .remedy = "Where the filter is installed: h5repack -f GZIP=1 IN OUT, or in h5py compression=\"gzip\"."};
  }
  return {};
}

}  // namespace

bool has_link(hid_t file, const std::string& path) {
  for (std::size_t end = path.find('/', 1);; end = path.find('/', end + 1)) {
    if (H5Lexists(file, path.substr(0, end).c_str(), H5P_DEFAULT) <= 0) return false;
    // What lies behind a link to another file is refused by name when it is opened.
    if (end == std::string::npos || !fault_of_link(file, path.substr(0, end)).empty()) return true;
  }
}

std::string fault_of_link(hid_t file, const std::string& path) {
  return fault_of_path(file, path, 0);
}

StorageFault fault_of_place(hid_t dataset) {
  const std::string elsewhere = "A history is one file: copy the values into it.";
  const Properties creation = creation_of(dataset);
  if (H5Pget_layout(creation) == H5D_VIRTUAL)
    return {.fault = "is a virtual dataset, made of other files", .remedy = elsewhere};
  if (H5Pget_external_count(creation) > 0) return {.fault = "has its values in another file", .remedy = elsewhere};
  return {};
}

StorageFault fault_of_storage(hid_t dataset) {
  const Properties creation = creation_of(dataset);
  const H5D_layout_t layout = H5Pget_layout(creation);
  if (StorageFault found = fault_of_filters(creation); !found.fault.empty()) return found;
  const Shape shape = shape_of(dataset);
  if (count_of(dataset) == 0) return {};
  if (layout != H5D_CHUNKED) {
    H5D_space_status_t status = H5D_SPACE_STATUS_ALLOCATED;
    if (layout == H5D_CONTIGUOUS && H5Dget_space_status(dataset, &status) >= 0 &&
        status == H5D_SPACE_STATUS_NOT_ALLOCATED)
      return {.fault = "was made, but its values were never written", .remedy = "Write them."};
    return {};
  }
  Shape chunk(shape.size());
  if (H5Pget_chunk(creation, static_cast<int>(chunk.size()), chunk.data()) < 0) return {};
  std::size_t bytes = H5Tget_size(type_of(dataset));
  for (const hsize_t length : chunk) bytes *= length;
  if (bytes > kMostChunkBytes)
    return {.fault = fmt::format("has chunks of {} bytes; at most {} are read", bytes, kMostChunkBytes),
            .remedy = "Write it with smaller chunks."};
  hsize_t written = 0;
  const hsize_t expected = chunks_of(shape, chunk);
  if (H5Dget_num_chunks(dataset, space_of(dataset), &written) >= 0 && written < expected)
    return {.fault = fmt::format("has {} chunks, of which {} were never written", expected, expected - written),
            .remedy = "Write all values; was the program that wrote them interrupted?"};
  return {};
}

}  // namespace shearbus::files::hdf5
