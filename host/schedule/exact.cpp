#include "interflect/base/error.h"
#include "interflect/schedule/scheduler.h"

namespace interflect {

void Scheduler::exact_product(const Columns& x, std::vector<std::vector<double>>& y) {
  if (x.size() != columns()) throw Error(ErrorKind::internal, "exact product: wrong number of columns");
  std::vector<std::vector<double>> wide;
  for (const std::vector<float>& column : x) {
    if (column.size() != size()) throw Error(ErrorKind::internal, "exact product: a column of the wrong length");
    wide.emplace_back(column.begin(), column.end());
  }
  y.assign(columns(), std::vector<double>(size()));
#pragma omp parallel for schedule(static)
  for (std::uint32_t i = 0; i < size(); ++i) {
    const float* row = form_factors_.row(i).data();
    for (std::size_t c = 0; c < wide.size(); ++c) {
      const double* column = wide[c].data();
      double sum = 0;
#pragma omp simd reduction(+ : sum)
      for (std::uint32_t j = 0; j < size(); ++j) sum += static_cast<double>(row[j]) * column[j];
      y[c][i] = sum;
    }
  }
  ++products_;
}

}  // namespace interflect
