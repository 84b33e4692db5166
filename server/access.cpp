#include "server/access.hpp"

#include <unistd.h>
#include <zmq.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "proto/files/key_file.hpp"

namespace shearbus::server {
namespace {

constexpr std::string_view kOperator = "operator ";
constexpr std::string_view kClient = "client ";

bool same_file(const struct stat& a, const struct stat& b) {
  return a.st_dev == b.st_dev && a.st_ino == b.st_ino && a.st_size == b.st_size &&
         a.st_mtim.tv_sec == b.st_mtim.tv_sec && a.st_mtim.tv_nsec == b.st_mtim.tv_nsec &&
         a.st_ctim.tv_sec == b.st_ctim.tv_sec && a.st_ctim.tv_nsec == b.st_ctim.tv_nsec;
}

transport::Admission admitted(bool is_operator, const std::string& identity) {
  return {.admitted = true, .user = std::string(is_operator ? kOperator : kClient) + identity};
}

}  // namespace

void Access::check(const ServerOptions& options) {
  if (options.curve_secret.empty() != options.authorized_keys.empty())
    throw std::invalid_argument(
        "--curve-secret and --authorized-keys go together: the server's own key, and those of its clients");
  if (!options.curve_secret.empty() && options.insecure_plaintext)
    throw std::invalid_argument("--insecure-plaintext would be without effect beside --curve-secret; leave it out");
}

Access::Access(const ServerOptions& options)
    : uids_(options.allow_uids), insecure_plaintext_(options.insecure_plaintext), keys_file_(options.authorized_keys) {
  check(options);
  uids_.push_back(::geteuid());
  if (options.curve_secret.empty()) return;
  secret_key_ = files::read_secret_key(options.curve_secret);
  read_authorized_keys();
}

std::string Access::public_key() const {
  std::array<char, files::kKeyCharacters + 1> key{};
  if (zmq_curve_public(key.data(), secret_key_.c_str()) != 0) throw std::runtime_error("the secret key is no key");
  return key.data();
}

std::vector<std::uint32_t> Access::other_users() const {
  std::vector<std::uint32_t> others = uids_;
  std::erase(others, ::geteuid());
  return others;
}

void Access::read_authorized_keys() {
  struct stat found {};
  if (::stat(keys_file_.c_str(), &found) != 0) throw std::runtime_error(keys_file_ + ": " + std::strerror(errno));
  if (same_file(found, keys_stat_)) return;
  keys_.clear();
  keys_stat_ = {};
  if (found.st_uid != ::geteuid() && found.st_uid != 0)
    throw std::runtime_error(keys_file_ + ": belongs to uid " + std::to_string(found.st_uid) +
                             ", who can let anybody in; expected root or uid " + std::to_string(::geteuid()) +
                             ", which the server runs as. chown it");
  if ((found.st_mode & 022) != 0)
    throw std::runtime_error(keys_file_ + ": others can write to it, and so let anybody in; chmod go-w it");
  for (const files::KeyLine& line : files::read_keys(keys_file_)) {
    const std::string first_word = line.words.substr(0, line.words.find_first_of(" \t"));
    keys_[line.key] = first_word == "operator";
  }
  keys_stat_ = found;
}

transport::Admission Access::judge(const transport::Peer& peer) {
  switch (peer.way) {
    case transport::Peer::Way::kIpc:
      if (std::find(uids_.begin(), uids_.end(), peer.uid) == uids_.end())
        return {.reason = "uid " + std::to_string(peer.uid) + " is not among --allow-uid"};
      return admitted(peer.uid == ::geteuid(), "uid " + std::to_string(peer.uid));
    case transport::Peer::Way::kCurve: {
      const std::lock_guard lock(mutex_);
      read_authorized_keys();
      const auto known = keys_.find(peer.public_key);
      if (known == keys_.end()) return {.reason = "key " + peer.public_key + " is not in " + keys_file_};
      transport::Admission admission = admitted(known->second, "key " + peer.public_key);
      admitted_.emplace(admission.user, peer.public_key);
      return admission;
    }
    case transport::Peer::Way::kPlaintext:
      if (!insecure_plaintext_) return {.reason = "it shows no key"};
      return admitted(false, "anonymous");
  }
  return {.reason = "it came by a way nobody knows"};
}

std::vector<std::string> Access::look_for_revoked() {
  std::vector<std::string> lines;
  if (keys_file_.empty()) return lines;
  const std::lock_guard lock(mutex_);
  try {
    read_authorized_keys();
    fault_.clear();
  } catch (const std::exception& fault) {
    if (fault_ != fault.what())
      lines.push_back(std::string("ALARM: no key is admitted, and none is revoked, until the file of authorised keys "
                                  "can be used: ") +
                      fault.what());
    fault_ = fault.what();
    return lines;
  }
  for (const auto& [user, key] : admitted_) {
    const auto known = keys_.find(key);
    const bool good = known != keys_.end() && known->second == user.starts_with(kOperator);
    if (good && revoked_.erase(user) != 0) lines.push_back("key " + key + " is authorised again");
    if (!good && revoked_.insert(user).second)
      lines.push_back("key " + key + (known == keys_.end() ? " was revoked" : " has another role now") +
                      ": requests by its connections are refused");
  }
  return lines;
}

service::Caller Access::caller(std::string_view user) {
  if (user.empty()) return {.identity = "process", .is_operator = true, .in_process = true};
  const bool is_operator = user.starts_with(kOperator);
  return {.identity = user.substr((is_operator ? kOperator : kClient).size()), .is_operator = is_operator};
}

}  // namespace shearbus::server
