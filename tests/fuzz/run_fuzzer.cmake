# Runs PROGRAM on a copy of CORPUS in FOLDER, where it also finds the files that its inputs name.
if(NOT IS_DIRECTORY ${CORPUS})
  message(FATAL_ERROR "no corpus at ${CORPUS}")
endif()
file(REMOVE_RECURSE ${FOLDER})
file(MAKE_DIRECTORY ${FOLDER})
file(COPY ${CORPUS}/ DESTINATION ${FOLDER}/corpus)
execute_process(
  COMMAND ${PROGRAM} -seed=1 -runs=20000 -max_total_time=20 -max_len=4096 -timeout=10 -rss_limit_mb=2048
    -malloc_limit_mb=512 -print_final_stats=1 -artifact_prefix=${FOLDER}/ corpus
  WORKING_DIRECTORY ${FOLDER}
  RESULT_VARIABLE status)
if(NOT status EQUAL 0)
  message(FATAL_ERROR "${PROGRAM} found something (status ${status}); the input lies in ${FOLDER}")
endif()
