#include "proto/files/fields.hpp"

#include <system_error>

#include "proto/files/recording_hdf5.hpp"

namespace shearbus::files {

using namespace hdf5;

namespace {

template <typename T>
Dataset write_values(hid_t file, const std::string& name, const Shape& shape, hid_t type, const T* values) {
  Dataset made = make_dataset(file, name, type, shape);
  hdf5::write(made, type, values);
  return made;
}

void write_numbers(hid_t file, const Quantity& quantity, const Shape& shape, const double* values) {
  const Dataset made = write_values(file, quantity.name, shape, H5T_IEEE_F64LE, values);
  put_text(made, "units", quantity.units);
  if (!quantity.long_name.empty()) put_text(made, "long_name", quantity.long_name);
}

bool is_sidecar(const std::filesystem::path& file) {
  return head_of(file, 64).find("<Xdmf") != std::string::npos;
}
constexpr FileKind kSidecarFile = {"an XDMF file", is_sidecar};

std::string frame_name(std::size_t number) {
  return fmt::format("{:05}.h5", number);
}

// Whether a file of the directory is a frame or the mesh, or was to become one.
bool is_frame(const std::string& name) {
  const std::size_t word = name.find(".h5");
  return name.starts_with("mesh.h5") ||
         (word == frame_name(0).find('.') && name.find_first_not_of("0123456789") == word);
}

}  // namespace

void remove_fields(const std::filesystem::path& sidecar) {
  std::filesystem::path directory = sidecar;
  directory.replace_extension();
  std::error_code none;
  for (const std::filesystem::directory_entry& entry : std::filesystem::directory_iterator(directory, none))
    if (is_frame(entry.path().filename().string())) std::filesystem::remove(entry.path());
  std::filesystem::remove(directory, none);  // unless it has files of others
  if (is_sidecar(sidecar)) std::filesystem::remove(sidecar);
}

std::string FieldWriter::item(const std::string& file, const char* dataset, const std::string& shape, const char* type,
                              int precision) const {
  return fmt::format(R"(<DataItem Format="HDF" NumberType="{}" Precision="{}" Dimensions="{}">{}/{}:/{}</DataItem>)",
                     type, precision, shape, directory_.filename().string(), file, dataset);
}

std::string FieldWriter::xdmf() const {
  const std::string vectors = fmt::format("{} 3", nodes_);
  std::string text =
      "<?xml version=\"1.0\"?>\n<Xdmf Version=\"3.0\">\n<Domain>\n"
      "<Grid Name=\"fields\" GridType=\"Collection\" CollectionType=\"Temporal\">\n";
  for (std::size_t frame = 0; frame < times_s_.size(); ++frame) {
    const std::string file = frame_name(frame);
    text += fmt::format(
        "<Grid Name=\"frame {0}\" GridType=\"Uniform\">\n<Time Value=\"{1:.17g}\"/>\n"
        "<Topology TopologyType=\"Quadrilateral\" NumberOfElements=\"{2}\">{3}</Topology>\n"
        "<Geometry GeometryType=\"XYZ\">{4}</Geometry>\n"
        "<Attribute Name=\"velocity\" AttributeType=\"Vector\" Center=\"Node\">{5}</Attribute>\n",
        frame, times_s_[frame], zones_, item("mesh.h5", "quads", fmt::format("{} 4", zones_), "Int", 4),
        item(file, "place", vectors, "Float", 8), item(file, "velocity", vectors, "Float", 8));
    for (const Quantity& quantity : quantities_)
      text += fmt::format("<Attribute Name=\"{}\" AttributeType=\"Scalar\" Center=\"Cell\">{}</Attribute>\n",
                          quantity.name, item(file, quantity.name.c_str(), std::to_string(zones_), "Float", 8));
    text += "</Grid>\n";
  }
  return text + "</Grid>\n</Domain>\n</Xdmf>\n";
}

FieldWriter::FieldWriter(std::filesystem::path sidecar, std::span<const std::int32_t> quads, std::size_t nodes,
                         std::vector<Quantity> zone_quantities, const std::string& scene, std::vector<double> times_s)
    : sidecar_(std::move(sidecar)),
      directory_(sidecar_),
      nodes_(nodes),
      zones_(quads.size() / 4),
      quantities_(std::move(zone_quantities)),
      times_s_(std::move(times_s)) {
  directory_.replace_extension();
  for (std::size_t frame = 0; frame < times_s_.size(); ++frame) {
    const std::filesystem::path file = directory_ / frame_name(frame);
    if (!std::filesystem::exists(file))
      refuse_file(file, fmt::format("the frame at {} s is missing", times_s_[frame]),
                  "The run's directory has been changed.");
  }
  if (times_s_.empty()) remove_fields(sidecar_);
  std::filesystem::create_directories(directory_);
  OutputHdf5 mesh(directory_ / "mesh.h5", kHdf5File);
  in_file(mesh.file(), [&] {
    put_text(mesh, "format", "shearbus-fields");
    put_text(mesh, "units_system", "SI");
    write_values(mesh, "quads", {zones_, 4}, H5T_STD_I32LE, quads.data());
    if (!scene.empty()) write_values(mesh, "scene", {scene.size()}, H5T_STD_U8LE, scene.data());
    mesh.close_and_publish();
  });
}

void FieldWriter::frame(double time_s, std::span<const double> place, std::span<const double> velocity,
                        std::span<const std::span<const double>> zones) {
  OutputHdf5 out(directory_ / frame_name(times_s_.size()), kHdf5File);
  in_file(out.file(), [&] {
    write_numbers(out, {"time", "s", ""}, {1}, &time_s);
    write_numbers(out, {"place", "m", ""}, {nodes_, 3}, place.data());
    write_numbers(out, {"velocity", "m s-1", ""}, {nodes_, 3}, velocity.data());
    for (std::size_t q = 0; q < quantities_.size(); ++q) write_numbers(out, quantities_[q], {zones_}, zones[q].data());
    out.close_and_publish();
  });
  times_s_.push_back(time_s);
  write_whole(sidecar_, kSidecarFile, xdmf());
}

}  // namespace shearbus::files
