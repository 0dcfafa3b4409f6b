# interflect_warnings(TARGET): the warnings that both compilers must pass without one.
function(interflect_warnings target)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wconversion
    # Clang's remark that a loop was not vectorised is about speed; under the sanitizers none is.
    $<$<CXX_COMPILER_ID:Clang>:-Wno-pass-failed>)
  if(INTERFLECT_WERROR)
    target_compile_options(${target} PRIVATE -Werror)
  endif()
endfunction()

# interflect_embed_page(LIST): adds the texts of the HTML page, three.js among them, to a list of sources.
function(interflect_embed_page list)
  find_file(INTERFLECT_THREE_JS three.min.js PATHS /usr/share/javascript/three/build /usr/share/javascript/three
    DOC "three.js, version 111, minified, as Debian's libjs-three has it")
  if(NOT INTERFLECT_THREE_JS)
    message(FATAL_ERROR "three.min.js is missing: install libjs-three, or set INTERFLECT_THREE_JS")
  endif()
  set(page ${PROJECT_SOURCE_DIR}/host/output/page)
  # In the order in which they become one script.
  set(program data.js light.js tone.js shader.js view.js camera.js controls.js legend.js lamps.js inspector.js share.js
    panel.js live.js main.js)
  list(TRANSFORM program PREPEND ${page}/ OUTPUT_VARIABLE program_files)
  list(JOIN program "," program)
  set(embedded ${PROJECT_BINARY_DIR}/embedded_page.cpp)
  add_custom_command(OUTPUT ${embedded}
    COMMAND ${CMAKE_COMMAND} -DPAGE=${page} -DTHREE=${INTERFLECT_THREE_JS} -DPROGRAM=${program} -DOUT=${embedded}
      -P ${PROJECT_SOURCE_DIR}/cmake/embed_page.cmake
    DEPENDS ${program_files} ${page}/page.html ${page}/page.css ${page}/live.css ${page}/three-licence.txt ${INTERFLECT_THREE_JS}
      ${PROJECT_SOURCE_DIR}/cmake/embed_page.cmake VERBATIM)
  set(${list} ${${list}} ${embedded} PARENT_SCOPE)
endfunction()

set(INTERFLECT_FLOORS "" CACHE INTERNAL "")
set(INTERFLECT_HEADER_ROOTS "" CACHE INTERNAL "")

# interflect_floor(NAME [DEPENDS floors...] [LIBRARIES targets...])
# host/NAME as an object library. Its headers are spelled "interflect/NAME/x.h", here and after installation; they are
# found only by a target that names the floor (or one above it) in DEPENDS, so that a wrong include does not build.
function(interflect_floor name)
  cmake_parse_arguments(PARSE_ARGV 1 floor "" "" "DEPENDS;LIBRARIES")
  set(header_root ${PROJECT_BINARY_DIR}/headers/${name})
  file(MAKE_DIRECTORY ${header_root}/interflect)
  file(CREATE_LINK ${PROJECT_SOURCE_DIR}/host/${name} ${header_root}/interflect/${name} SYMBOLIC)

  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/host/${name}/*.cpp)
  if(name STREQUAL "device")
    file(GLOB kernels CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/kernels/omp/*.cpp)
    list(APPEND sources ${kernels})
    file(GLOB device_kernels CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/kernels/*/*)
    set(embedded ${PROJECT_BINARY_DIR}/embedded_kernels.cpp)
    add_custom_command(OUTPUT ${embedded}
      COMMAND ${CMAKE_COMMAND} -DKERNELS=${PROJECT_SOURCE_DIR}/kernels -DOUT=${embedded}
        -P ${PROJECT_SOURCE_DIR}/cmake/embed_kernels.cmake
      DEPENDS ${device_kernels} ${PROJECT_SOURCE_DIR}/cmake/embed_kernels.cmake VERBATIM)
    list(APPEND sources ${embedded})
  endif()
  if(name STREQUAL "output")
    interflect_embed_page(sources)
  endif()
  set(target interflect_${name})
  add_library(${target} OBJECT ${sources})
  target_include_directories(${target} PUBLIC ${header_root})
  if(name STREQUAL "device")
    # "omp/NAME.cpp": Highway includes a kernel once per instruction set
    target_include_directories(${target} PRIVATE ${PROJECT_SOURCE_DIR}/kernels)
  endif()
  foreach(below IN LISTS floor_DEPENDS)
    target_link_libraries(${target} PUBLIC interflect_${below})
  endforeach()
  target_link_libraries(${target} PRIVATE ${floor_LIBRARIES} fmt::fmt OpenMP::OpenMP_CXX Threads::Threads)
  interflect_warnings(${target})

  set(INTERFLECT_FLOORS ${INTERFLECT_FLOORS} ${name} CACHE INTERNAL "")
  set(INTERFLECT_HEADER_ROOTS ${INTERFLECT_HEADER_ROOTS} ${header_root} CACHE INTERNAL "")
endfunction()
