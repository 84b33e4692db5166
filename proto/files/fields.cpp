#include "proto/files/fields.hpp"

#include <array>
#include <system_error>

#include "proto/files/recording_hdf5.hpp"

namespace shearbus::files {

using namespace hdf5;

namespace {

// A file being written.
struct Part {
  PartialFile partial;
  const std::filesystem::path& file;
  File hdf;

  explicit Part(const std::filesystem::path& name)
      : partial(name, kHdf5File, PartialFile::Writers::kOne), file(partial.file()), hdf(create_file(partial)) {}

  void attribute(hid_t of, const char* name, const std::string& text) const {
    const Type type(checked(H5Tcopy(H5T_C_S1), file, "cannot make a text type"));
    checked(H5Tset_size(type, text.size() + 1), file, "cannot size a text");
    const Space space(checked(H5Screate(H5S_SCALAR), file, "cannot make a scalar"));
    const Attribute attribute(
        checked(H5Acreate2(of, name, type, space, H5P_DEFAULT, H5P_DEFAULT), file, "cannot make an attribute"));
    checked(H5Awrite(attribute, type, text.c_str()), file, "cannot write an attribute");
  }

  template <std::size_t kRank>
  Dataset dataset(const std::string& name, const std::array<hsize_t, kRank>& shape, hid_t file_type, hid_t memory_type,
                  const void* values) const {
    const Space space(checked(H5Screate_simple(kRank, shape.data(), nullptr), file, "cannot make a shape"));
    Dataset made(checked(H5Dcreate2(hdf, name.c_str(), file_type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), file,
                         "cannot make a dataset"));
    checked(H5Dwrite(made, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values), file, "cannot write a dataset");
    return made;
  }

  void close() { close_and_publish(hdf, partial); }
};

bool is_sidecar(const std::filesystem::path& file) {
  return head_of(file, 64).find("<Xdmf") != std::string::npos;
}
constexpr FileKind kSidecarFile = {"an XDMF file", is_sidecar};

std::string frame_name(std::size_t number) {
  return fmt::format("{:05}.h5", number);
}

}  // namespace

struct FieldWriter::Impl {
  std::filesystem::path sidecar;
  std::filesystem::path directory;
  std::size_t nodes = 0;
  std::size_t zones = 0;
  std::vector<Quantity> quantities;
  std::vector<double> times;

  std::string item(const std::string& file, const char* dataset, const std::string& shape, const char* type,
                   int precision) const {
    return fmt::format(R"(<DataItem Format="HDF" NumberType="{}" Precision="{}" Dimensions="{}">{}/{}:/{}</DataItem>)",
                       type, precision, shape, directory.filename().string(), file, dataset);
  }

  std::string xdmf() const {
    const std::string vectors = fmt::format("{} 3", nodes);
    std::string text =
        "<?xml version=\"1.0\"?>\n<Xdmf Version=\"3.0\">\n<Domain>\n"
        "<Grid Name=\"fields\" GridType=\"Collection\" CollectionType=\"Temporal\">\n";
    for (std::size_t frame = 0; frame < times.size(); ++frame) {
      const std::string file = frame_name(frame);
      text += fmt::format(
          "<Grid Name=\"frame {0}\" GridType=\"Uniform\">\n<Time Value=\"{1:.17g}\"/>\n"
          "<Topology TopologyType=\"Quadrilateral\" NumberOfElements=\"{2}\">{3}</Topology>\n"
          "<Geometry GeometryType=\"XYZ\">{4}</Geometry>\n"
          "<Attribute Name=\"velocity\" AttributeType=\"Vector\" Center=\"Node\">{5}</Attribute>\n",
          frame, times[frame], zones, item("mesh.h5", "quads", fmt::format("{} 4", zones), "Int", 4),
          item(file, "place", vectors, "Float", 8), item(file, "velocity", vectors, "Float", 8));
      for (const Quantity& quantity : quantities) {
        text += fmt::format("<Attribute Name=\"{}\" AttributeType=\"Scalar\" Center=\"Cell\">{}</Attribute>\n",
                            quantity.name, item(file, quantity.name.c_str(), std::to_string(zones), "Float", 8));
      }
      text += "</Grid>\n";
    }
    return text + "</Grid>\n</Domain>\n</Xdmf>\n";
  }

  void write_sidecar() const { write_whole(sidecar, kSidecarFile, xdmf()); }
};

FieldWriter::FieldWriter(std::filesystem::path sidecar, std::span<const std::int32_t> quads, std::size_t nodes,
                         std::vector<Quantity> zone_quantities, const std::string& scene, std::vector<double> times_s)
    : impl_(std::make_unique<Impl>()) {
  const Quiet quiet;
  Impl& w = *impl_;
  w.sidecar = std::move(sidecar);
  w.directory = w.sidecar;
  w.directory.replace_extension();
  w.nodes = nodes;
  w.zones = quads.size() / 4;
  w.quantities = std::move(zone_quantities);
  w.times = std::move(times_s);
  for (std::size_t frame = 0; frame < w.times.size(); ++frame) {
    const std::filesystem::path file = w.directory / frame_name(frame);
    if (!std::filesystem::exists(file))
      refuse(file, fmt::format("the frame at {} s is missing", w.times[frame]),
             "The run's directory has been changed.");
  }
  if (w.times.empty()) {
    std::filesystem::remove(w.sidecar);
    std::filesystem::remove_all(w.directory);
  }
  std::filesystem::create_directories(w.directory);
  Part mesh(w.directory / "mesh.h5");
  mesh.attribute(mesh.hdf, "format", "shearbus-fields");
  mesh.attribute(mesh.hdf, "units_system", "SI");
  mesh.dataset<2>("quads", {w.zones, 4}, H5T_STD_I32LE, H5T_NATIVE_INT32, quads.data());
  if (!scene.empty()) mesh.dataset<1>("scene", {scene.size()}, H5T_STD_U8LE, H5T_NATIVE_UINT8, scene.data());
  mesh.close();
}
FieldWriter::FieldWriter(FieldWriter&&) noexcept = default;
FieldWriter& FieldWriter::operator=(FieldWriter&&) noexcept = default;
FieldWriter::~FieldWriter() = default;

void FieldWriter::frame(double time_s, std::span<const double> place, std::span<const double> velocity,
                        std::span<const std::span<const double>> zones) {
  const Quiet quiet;
  Impl& w = *impl_;
  Part part(w.directory / frame_name(w.times.size()));
  part.attribute(part.dataset<1>("time", {1}, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &time_s), "units", "s");
  part.attribute(part.dataset<2>("place", {w.nodes, 3}, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, place.data()), "units", "m");
  part.attribute(part.dataset<2>("velocity", {w.nodes, 3}, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, velocity.data()), "units",
                 "m s-1");
  for (std::size_t q = 0; q < w.quantities.size(); ++q) {
    const Quantity& quantity = w.quantities[q];
    const Dataset values =
        part.dataset<1>(quantity.name, {w.zones}, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, zones[q].data());
    part.attribute(values, "units", quantity.units);
    part.attribute(values, "long_name", quantity.long_name);
  }
  part.close();
  w.times.push_back(time_s);
  w.write_sidecar();
}

const std::vector<double>& FieldWriter::times_s() const {
  return impl_->times;
}

}  // namespace shearbus::files
