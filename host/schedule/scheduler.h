#pragma once

#include <memory>

#include "interflect/formfactor/form_factor_matrix.h"

namespace interflect {

class Scheduler;

}  // namespace interflect
