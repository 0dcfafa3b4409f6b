# Installs Interflect, builds examples/read-radiosities with find_package(Interflect), and runs it on the furnace, where
# the radiosity of every wall is e / (1 - rho).
set(work ${BUILD_DIR}/package_example)
file(REMOVE_RECURSE ${work})
function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE status OUTPUT_VARIABLE out ERROR_VARIABLE err)
  if(NOT status EQUAL 0)
    message(FATAL_ERROR "${ARGN}\nstatus ${status}\n${out}\n${err}")
  endif()
  set(output "${out}" PARENT_SCOPE)
endfunction()

run(${CMAKE_COMMAND} --install ${BUILD_DIR} --prefix ${work}/prefix)
run(${CMAKE_COMMAND} -S ${SOURCE_DIR}/examples/read-radiosities -B ${work}/build -G ${GENERATOR}
  -DCMAKE_PREFIX_PATH=${work}/prefix -DCMAKE_CXX_COMPILER=${CXX} -DCMAKE_CXX_FLAGS=${CXX_FLAGS}
  -DCMAKE_BUILD_TYPE=Release)
run(${CMAKE_COMMAND} --build ${work}/build)
run(${work}/build/read-radiosities ${SOURCE_DIR}/scenes/furnace.obj 200)
message(STATUS "example printed:\n${output}")
file(READ ${SOURCE_DIR}/scenes/furnace.mtl material)
if(NOT output MATCHES "([0-9]+) patches, ([0-9]+) products, converged")
  message(FATAL_ERROR "not converged")
endif()
run(python3 ${SOURCE_DIR}/tests/cli/check_furnace.py ${SOURCE_DIR}/scenes/furnace.mtl "${output}")
run(${work}/prefix/bin/interflect --version)
