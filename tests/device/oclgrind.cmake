# cmake -DPROGRAM=interflect -DKERNELS=kernels -DWORK=folder -DSHAPE=cpu|gpu -DMAX_SIZE=n [-DBREAK=barrier|bounds]
#   [-DSANITIZED=ON] -P oclgrind.cmake
# Runs the kernels of kernels/cl/ in oclgrind, which looks at every memory access of every work-item: any message fails.
# With BREAK a copy of the kernels is broken first, and the message that it must give is asked for instead.
# Not --uninitialized: that plugin of oclgrind 21.10 ends in a segmentation fault on vectors.
if(SANITIZED)
  message(STATUS "SKIPPED: oclgrind is loaded before the program, and so must the address sanitizer be")
  return()
endif()
find_program(OCLGRIND oclgrind)
if(NOT OCLGRIND)
  message(STATUS "SKIPPED: oclgrind is not installed")
  return()
endif()

file(REMOVE_RECURSE ${WORK})
file(MAKE_DIRECTORY ${WORK})
file(COPY ${KERNELS}/ DESTINATION ${WORK}/kernels)

function(break_kernel file from to)
  file(READ ${WORK}/kernels/cl/${file} text)
  string(REPLACE "${from}" "${to}" broken "${text}")
  if(broken STREQUAL text)
    message(FATAL_ERROR "cl/${file} has no '${from}'")
  endif()
  file(WRITE ${WORK}/kernels/cl/${file} "${broken}")
endfunction()
set(wanted "")
if(BREAK STREQUAL "barrier")
  break_kernel(blocks.cl "barrier(CLK_LOCAL_MEM_FENCE);  // the level before is there" "")
  set(wanted "data race")
elseif(BREAK STREQUAL "bounds")
  break_kernel(reduce.cl "b.index)] = xy" "b.index) + 100000] = xy")
  set(wanted "Invalid write")
elseif(BREAK)
  message(FATAL_ERROR "no such way to break a kernel: ${BREAK}")
endif()

# 64 work-items instead of 256: a work-group is as long as a sum's tree can be, and four times as fast.
execute_process(
  COMMAND ${CMAKE_COMMAND} -E env INTERFLECT_KERNEL_DIR=${WORK}/kernels INTERFLECT_CACHE=off
    INTERFLECT_OPENCL_SHAPE=${SHAPE} OMP_WAIT_POLICY=passive
    ${OCLGRIND} --data-races --check-api --max-wgsize 64 --log ${WORK}/messages
    ${PROGRAM} check --device opencl:0 --max-size ${MAX_SIZE}
  OUTPUT_VARIABLE out ERROR_VARIABLE err RESULT_VARIABLE status)
set(messages "")
if(EXISTS ${WORK}/messages)
  file(READ ${WORK}/messages messages)
endif()
string(SUBSTRING "${messages}" 0 4000 shown)
string(REGEX MATCH "[0-9]+ passed, [0-9]+ failed[^\n]*" summary "${out}")
message(STATUS "${summary}")
if(wanted)
  if(NOT messages MATCHES "${wanted}")
    message(FATAL_ERROR "oclgrind did not say '${wanted}' of the broken kernel, but:\n${shown}\n${err}")
  endif()
elseif(NOT status EQUAL 0 OR NOT messages STREQUAL "" OR NOT summary MATCHES "^[1-9][0-9]* passed, 0 failed")
  message(FATAL_ERROR "exit status ${status}\n${shown}\n${err}")
endif()
