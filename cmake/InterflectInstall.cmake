# cmake --install: program, library, headers, and a package for find_package(Interflect).
include(CMakePackageConfigHelpers)

install(TARGETS interflect EXPORT InterflectTargets LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
install(TARGETS interflect-program RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
foreach(floor IN LISTS INTERFLECT_FLOORS)
  install(DIRECTORY host/${floor}/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/interflect/${floor}
    FILES_MATCHING PATTERN "*.h")
endforeach()
install(EXPORT InterflectTargets NAMESPACE Interflect:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/Interflect)
configure_package_config_file(cmake/InterflectConfig.cmake.in ${PROJECT_BINARY_DIR}/InterflectConfig.cmake
  INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/Interflect)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/InterflectConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/InterflectConfig.cmake ${PROJECT_BINARY_DIR}/InterflectConfigVersion.cmake
  DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/Interflect)
install(DIRECTORY scenes DESTINATION ${CMAKE_INSTALL_DATADIR}/interflect)  # bench --study looks for them there
install(FILES LICENSE README.md DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(DIRECTORY scenes/ DESTINATION ${CMAKE_INSTALL_DATADIR}/interflect/scenes
  FILES_MATCHING PATTERN "*.obj" PATTERN "*.mtl" PATTERN "README.md")
