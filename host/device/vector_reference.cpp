#include "interflect/device/vector_reference.h"

#include <algorithm>
#include <array>
#include <string>

#include "interflect/base/error.h"

namespace interflect::reference {

namespace {

/// One column of a launch.
class Column {
 public:
  Column(const VectorArguments& a, std::vector<Numbers>& buffers, std::uint32_t c) : a_(a), buffers_(buffers), c_(c) {}

  [[nodiscard]] std::uint32_t n() const { return a_.n; }
  [[nodiscard]] std::uint32_t option() const { return a_.option; }
  [[nodiscard]] std::uint32_t result_slot() const { return a_.slot; }
  /// Element i of vector k.
  [[nodiscard]] Number get(std::size_t k, std::uint32_t i) const { return buffers_[k][element(i)]; }
  void set(std::size_t k, std::uint32_t i, Number value) { write(buffers_[k][element(i)], value); }

  [[nodiscard]] Number slot(std::uint32_t s) const { return sums()[s * a_.columns + c_]; }
  void set_slot(std::uint32_t s, Number value) { write(sums()[s * a_.columns + c_], value); }
  /// The sum of a set's partial sums, as they were before the launch.
  [[nodiscard]] Number total(std::uint32_t set) const {
    Number sum;
    for (std::uint32_t block = 0; block < a_.blocks; ++block) sum = sum + sums()[partial(set, block)];
    return sum;
  }
  /// The block's partial sums of terms that are given per element.
  template <class Term>
  void set_partials(std::uint32_t set, Term term) {
    for (std::uint32_t block = 0; block < a_.blocks; ++block) {
      Number sum;
      for (std::uint32_t i = block * reduction_block; i < std::min(a_.n, (block + 1) * reduction_block); ++i) {
        sum = sum + term(i);
      }
      write(sums()[partial(set, block)], sum);
    }
  }

 private:
  [[nodiscard]] std::size_t element(std::uint32_t i) const { return std::size_t{c_} * a_.vector_stride + i; }
  [[nodiscard]] std::size_t partial(std::uint32_t set, std::uint32_t block) const {
    return std::size_t{scalar_slots} * a_.columns + (std::size_t{set} * a_.columns + c_) * a_.blocks + block;
  }
  [[nodiscard]] Numbers& sums() const { return buffers_.back(); }
  static void write(Number& to, Number value) {
    to = value;
    to.written = true;
  }

  const VectorArguments& a_;
  std::vector<Numbers>& buffers_;
  std::uint32_t c_;
};

Number quotient_or_zero(Number a, Number b) {
  if (a.value == 0 || b.value == 0) return {};
  const Number q = a / b;
  return std::abs(q.value) < 1e30 ? q : Number();
}

void dot(Column& k) {
  k.set_partials(k.option(), [&](std::uint32_t i) { return k.get(0, i) * k.get(1, i); });
}

void reduce(Column& k) {
  k.set_slot(k.result_slot(), k.total(k.option()));
}

void axpby(Column& k) {
  const Number a = k.slot(slot::axpby_a), b = k.slot(slot::axpby_b);
  for (std::uint32_t i = 0; i < k.n(); ++i) k.set(1, i, a * k.get(0, i) + b * k.get(1, i));
}

void bounce(Column& k) {
  constexpr std::size_t y = 0, rho = 1, d = 2, r = 3, x = 4;
  for (std::uint32_t i = 0; i < k.n(); ++i) {
    k.set(r, i, k.get(rho, i) * k.get(y, i));
    if (k.option() == 1) k.set(x, i, k.get(x, i) + k.get(r, i));
  }
  k.set_partials(sum::rr, [&](std::uint32_t i) { return k.get(r, i) * k.get(r, i); });
  k.set_partials(sum::gamma, [&](std::uint32_t i) { return k.get(d, i) * k.get(r, i) * k.get(r, i); });
}

void cg_product(Column& k) {
  constexpr std::size_t w = 0, rho = 1, d = 2, r = 3;
  for (std::uint32_t i = 0; i < k.n(); ++i) k.set(w, i, k.get(r, i) - k.get(rho, i) * k.get(w, i));
  k.set_partials(sum::delta, [&](std::uint32_t i) { return k.get(d, i) * k.get(r, i) * k.get(w, i); });
  const bool open = k.total(sum::rr).value > k.slot(slot::target).value;
  const bool restart = k.slot(slot::alpha).value == 0;
  const Number gamma = open ? k.total(sum::gamma) : Number();
  const Number beta = restart ? Number() : quotient_or_zero(gamma, k.slot(slot::cg_gamma_old));
  const Number shift = restart ? Number() : quotient_or_zero(beta * gamma, k.slot(slot::alpha));
  k.set_slot(slot::cg_gamma, gamma);
  k.set_slot(slot::cg_beta, beta);
  k.set_slot(slot::cg_shift, shift);
}

void cg_step(Column& k) {
  constexpr std::size_t w = 0, d = 1, r = 2, p = 3, s = 4, x = 5;
  const Number gamma = k.slot(slot::cg_gamma), beta = k.slot(slot::cg_beta);
  const Number curvature = k.total(sum::delta) - k.slot(slot::cg_shift);
  const bool step = gamma.value > 0 && curvature.value > 0;
  const Number alpha = step ? quotient_or_zero(gamma, curvature) : Number();
  k.set_slot(slot::alpha, alpha);
  k.set_slot(slot::cg_gamma_old, gamma);
  for (std::uint32_t i = 0; step && i < k.n(); ++i) {
    k.set(p, i, k.get(r, i) + beta * k.get(p, i));
    k.set(s, i, k.get(w, i) + beta * k.get(s, i));
    k.set(x, i, k.get(x, i) + alpha * k.get(p, i));
    k.set(r, i, k.get(r, i) - alpha * k.get(s, i));
  }
  k.set_partials(sum::rr, [&](std::uint32_t i) { return k.get(r, i) * k.get(r, i); });
  k.set_partials(sum::gamma, [&](std::uint32_t i) { return k.get(d, i) * k.get(r, i) * k.get(r, i); });
}

void bicgstab_product(Column& k) {
  constexpr std::size_t x = 0, w = 1, rho = 2, z = 3;
  for (std::uint32_t i = 0; i < k.n(); ++i) k.set(w, i, k.get(x, i) - k.get(rho, i) * k.get(w, i));
  const auto dot = [&](std::uint32_t set, std::size_t a, std::size_t b) {
    k.set_partials(set, [&](std::uint32_t i) { return k.get(a, i) * k.get(b, i); });
  };
  dot(sum::xw, x, w);
  dot(sum::ww, w, w);
  dot(sum::zx, z, x);
  dot(sum::zw, z, w);
  dot(sum::xx, x, x);
}

constexpr double noise_squared = 1e-13;

void bicgstab_half(Column& k) {
  constexpr std::size_t v = 0, r = 1;
  const bool fresh = k.slot(slot::bicgstab_rho).value == 0;
  const Number rr = k.total(sum::rr), zv = k.total(sum::zw), vv = k.total(sum::ww);
  const Number rho = fresh ? rr : k.slot(slot::bicgstab_rho);
  const Number zz = fresh ? rr : k.slot(slot::bicgstab_shadow);
  const bool open = rr.value > k.slot(slot::target).value;
  const bool sound = zv.value * zv.value > noise_squared * zz.value * vv.value;
  const Number alpha = open && sound ? quotient_or_zero(rho, zv) : Number();
  k.set_slot(slot::alpha, alpha);
  k.set_slot(slot::bicgstab_rho_used, rho);
  if (fresh) k.set_slot(slot::bicgstab_shadow, zz);
  if (open && alpha.value == 0) k.set_slot(slot::bicgstab_restarts, k.slot(slot::bicgstab_restarts) + Number(1));
  for (std::uint32_t i = 0; alpha.value != 0 && i < k.n(); ++i) k.set(r, i, k.get(r, i) - alpha * k.get(v, i));
}

void bicgstab_step(Column& k) {
  constexpr std::size_t v = 0, t = 1, z = 2, x = 3, r = 4, p = 5;
  const Number alpha = k.slot(slot::alpha), ts = k.total(sum::xw), tt = k.total(sum::ww), two(2);
  const Number omega = alpha.value == 0 ? Number() : quotient_or_zero(ts, tt);
  const Number rho = k.total(sum::zx) - omega * k.total(sum::zw);
  const Number rr = k.total(sum::xx) - omega * (two * ts - omega * tt);
  const Number beta = quotient_or_zero(rho * alpha, k.slot(slot::bicgstab_rho_used) * omega);
  const double noise = noise_squared * k.slot(slot::bicgstab_shadow).value * rr.value;
  const bool restart = beta.value == 0 || !(rho.value * rho.value > noise);
  for (std::uint32_t i = 0; i < k.n(); ++i) {
    if (alpha.value != 0) {
      k.set(x, i, k.get(x, i) + alpha * k.get(p, i) + omega * k.get(r, i));
      k.set(r, i, k.get(r, i) - omega * k.get(t, i));
    }
    k.set(p, i, restart ? k.get(r, i) : k.get(r, i) + beta * (k.get(p, i) - omega * k.get(v, i)));
    if (restart) k.set(z, i, k.get(r, i));
  }
  k.set_partials(sum::rr, [&](std::uint32_t i) { return k.get(r, i) * k.get(r, i); });
  k.set_slot(slot::bicgstab_rho, restart ? Number() : rho);
  if (restart && alpha.value != 0) {
    k.set_slot(slot::bicgstab_restarts, k.slot(slot::bicgstab_restarts) + Number(1));
  }
}

struct Line {
  std::string_view name;
  std::size_t vectors;
  void (*run)(Column&);
};

constexpr std::array lines{Line{"dot", 2, &dot},
                           Line{"reduce", 0, &reduce},
                           Line{"axpby", 2, &axpby},
                           Line{"bounce", 5, &bounce},
                           Line{"cg_product", 4, &cg_product},
                           Line{"cg_step", 6, &cg_step},
                           Line{"bicgstab_product", 4, &bicgstab_product},
                           Line{"bicgstab_half", 2, &bicgstab_half},
                           Line{"bicgstab_step", 6, &bicgstab_step}};

const Line& line(std::string_view name) {
  const auto* found = std::find_if(lines.begin(), lines.end(), [&](const Line& l) { return l.name == name; });
  if (found == lines.end()) throw Error(ErrorKind::internal, "no vector kernel " + std::string(name));
  return *found;
}

}  // namespace

void vector_kernel(std::string_view name, const VectorArguments& arguments, std::vector<Numbers>& buffers) {
  for (std::uint32_t c = 0; c < arguments.columns; ++c) {
    Column column(arguments, buffers, c);
    line(name).run(column);
  }
}

std::size_t vectors_of(std::string_view name) {
  return line(name).vectors;
}

std::uint64_t vector_roundings(const VectorArguments& arguments) {
  return 80 + 8 * (std::uint64_t{arguments.blocks} + 4);
}

}  // namespace interflect::reference
