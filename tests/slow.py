"""The tests that take seconds each, by file; the others together take three minutes on two cores. A folder is slow as a whole."""

SLOW_FOLDERS = ("statistics", "reproductions")
SLOW = {
    "commands/test_simulate_flight.py": ("test_the_numbers_of_the_failing_elevator",),
    "contract/test_catalogue.py": (
        "test_a_second_process_traces_nothing",
        "test_gradients_are_finite_with_missing_data",
        "test_keeping_less_changes_nothing_that_is_kept",
        "test_new_numbers_do_not_compile_again",
        "test_online_equals_offline_and_resumes",
    ),
    "contract/test_methods.py": ("test_a_controller_acts_alike_everywhere",),
    "diagnostics/test_innovation_tests.py": ("test_a_right_model_alarms_as_rarely_as_is_said",),
    "documents/test_examples.py": ("test_every_python_block_of_a_page_runs",),
    "documents/test_site.py": ("test_the_build_draws_a_figure_for_every_method",),
    "engines/test_arrays.py": (
        "test_every_entry_of_the_catalogue_gives_the_same_as_arrays",
        "test_large_models_are_smoothed_as_machine_code",
    ),
    "engines/test_primitives.py": (
        "test_a_constant_argument_changes_nothing_but_products_with_zero",
        "test_every_row_gives_what_xla_gives",
        "test_random_programs_of_floats_integers_and_bools_give_what_xla_gives",
    ),
    "engines/test_straight_line.py": ("test_every_entry_of_the_catalogue_gives_the_same",),
    "estimation/test_online_steps.py": ("test_machine_code_says_at_each_sample_what_xla_says",),
    "estimation/test_smooth.py": ("test_a_gain_that_walks_is_smoothed_with_its_state",),
    "filters/test_change_detection.py": (
        "test_it_finds_the_failure_of_the_f16_sooner_than_a_window_can",
        "test_of_a_model_straight_in_its_parameter_a_nonlinear_filter_finds_what_the_exact_one_does",
        "test_the_statistic_sums_the_exact_likelihood_ratios_of_every_onset",
    ),
    "filters/test_input_noise.py": ("test_an_unknown_gain_scales_the_error_by_its_second_moment",),
    "filters/test_moving_window.py": (
        "test_every_row_is_the_algorithm_started_anew",
        "test_the_scan_of_windows_says_what_each_window_says",
    ),
    "filters/test_nonlinear.py": (
        "test_a_continuous_linear_model_of_functions_is_the_discretised_one",
        "test_a_continuous_simulation_follows_the_equations_and_its_noise_has_the_right_size",
        "test_engines_and_online_agree",
        "test_of_a_linear_model_each_is_the_kalman_filter",
        "test_of_the_map_the_second_order_is_that_of_a_discrete_model_whose_step_is_the_path",
        "test_the_moments_between_samples_are_those_of_the_textbook_equations",
    ),
    "filters/test_numerics.py": ("test_covariances_stay_positive_semidefinite_over_a_million_steps",),
    "filters/test_unknown_gain.py": (
        "test_a_scaled_feedthrough_is_multiplied_by_the_same_gain",
        "test_words_for_directions_are_the_matrices_they_stand_for",
    ),
    "filters/test_unknown_input.py": (
        "test_equals_least_squares_over_the_whole_record",
        "test_smoothed_it_equals_least_squares_with_later_samples",
    ),
    "fuzz/test_fuzz.py": (
        "test_wrong_calls_end_with_a_sentence",
        "test_wrong_command_lines_end_with_a_sentence",
    ),
    "identifiers/test_adaptive_identification.py": (
        "test_the_likelihood_has_its_peak_where_the_refinement_ends_and_its_curvature_is_the_information",
    ),
    "identifiers/test_joint_output_error.py": ("test_fates_that_nobody_tells_leave_an_estimate_without_bias",),
    "identifiers/test_output_error_ml.py": ("test_it_is_as_good_as_the_information_in_what_arrived",),
    "identifiers/test_state_space_identifiers.py": ("test_the_covariance_of_subspace_is_that_of_its_errors",),
    "identifiers/test_uncertain_inputs.py": ("test_fates_that_nobody_tells",),
    "kernels/test_all_outputs.py": (
        "test_all_outputs_at_once_tell_what_they_tell_in_turn",
        "test_contradictions_are_found",
        "test_derivatives_are_those_of_the_outputs_in_turn",
    ),
    "kernels/test_small.py": ("test_a_recursion_settles_to_the_last_bit_and_within_rounding_of_its_limit",),
    "plants/test_f16_failure.py": ("test_packets_may_get_lost_on_both_ways",),
    "properties/test_linear_filters.py": ("test_online_equals_offline_and_resumes_from_a_file",),
    "simulation/test_close_loop.py": ("test_commands_and_outputs_are_rounded_to_what_can_be_told_apart",),
    "simulation/test_cluster.py": (
        "test_a_cluster_whose_workers_are_all_lost_ends_in_a_sentence",
        "test_a_killed_worker_and_a_killed_scheduler_lose_nothing",
        "test_a_scheduler_without_workers_is_one_sentence_within_ten_seconds",
        "test_what_the_workers_cannot_load_is_named",
    ),
    "simulation/test_monte_carlo.py": ("test_values_do_not_depend_on_the_chunk_or_on_the_number_of_runs",),
    "simulation/test_window_loop.py": ("test_blocks_and_copies_agree",),
    "store/test_round_trip.py": ("test_a_fresh_process_loads_the_modules_of_what_is_in_the_file_and_no_others",),
    "trust/test_cache.py": ("test_the_folder_and_its_files_are_private",),
    "trust/test_forks_and_threads.py": ("test_forked_and_spawned_processes_give_the_same_bits_or_a_sentence",),
    "trust/test_full_disk.py": ("test_a_full_disk_leaves_the_old_files",),
    "trust/test_kill.py": ("test_a_killed_process_is_continued_to_the_same_bits",),
}
