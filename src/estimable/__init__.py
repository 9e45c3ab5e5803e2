"""Estimation, identification and adaptive control when part of the loop is unknown."""

from . import precision as _precision  # isort: skip  # noqa: F401  float64, before any array is made
from . import catalogue, diagnostics, packaged, plants, report
from .analysis.estimability import Estimability, estimability
from .analysis.excitation import excitation
from .analysis.gain_information import GainInformation, gain_information
from .analysis.loss_tolerance import ArrivalCovariance, LossTolerance, loss_tolerance
from .analysis.observability import Observability, Reachability, observability, reachability
from .analysis.positive_real import positive_real_margin
from .analysis.reduction import Reduction, reduce
from .analysis.regulability import Regulability, regulability
from .analysis.rho import Perturbed, RhoMargin, StabilityRadius, rho_margin, stability_radius
from .analysis.unknown_input import UnknownInputExistence, unknown_input_existence
from .controllers.dither import Dither
from .controllers.gain_reconfiguration import GainReconfiguration
from .controllers.proportional_integral import ProportionalIntegral
from .controllers.state_feedback import StateFeedback
from .controllers.tracking import Tracking
from .data.reading import read_record
from .data.record import Record
from .data.trends import Trend
from .design.alpha_beta import (
    TrackerChoices,
    alpha_beta_choices,
    alpha_beta_covariance,
    alpha_beta_gains,
    alpha_beta_gamma_gains,
)
from .design.disturbance_accommodation import DisturbanceAccommodation, disturbance_accommodation
from .design.families import DesignFamily
from .design.gains import FeedbackGain, KalmanGain, filter_covariance, kalman_gain, lqr_gain
from .design.rho_synthesis import RhoSynthesis, rho_synthesis
from .design.trans_kalman import TransKalman, trans_kalman
from .design.waveforms import Waveform
from .errors import AssumptionError, EstimableError, EstimableWarning, InputError, RunError
from .filters.alpha_beta import AlphaBeta
from .filters.bounded import Bounded
from .filters.change_detection import ChangeDetection
from .filters.extended_kalman import ExtendedKalman
from .filters.fixed_gain import FixedGain
from .filters.gated import Gated
from .filters.kalman import Kalman
from .filters.moving_window import MovingWindow
from .filters.second_order_kalman import SecondOrderKalman
from .filters.smoothed import Smoothed
from .filters.unknown_gain import UnknownGain
from .filters.unknown_input import UnknownInput
from .filters.unscented_kalman import UnscentedKalman
from .identifiers.adaptive_identification import AdaptiveIdentification
from .identifiers.coupled_least_squares import CoupledLeastSquares
from .identifiers.ho_kalman import HoKalman
from .identifiers.instrumental_variables import InstrumentalVariables
from .identifiers.joint_output_error import JointOutputError
from .identifiers.least_squares import LeastSquares
from .identifiers.markov_parameters import MarkovParameters
from .identifiers.minimum_variance import MinimumVariance
from .identifiers.output_error_ml import OutputErrorML
from .identifiers.phasor import Phasor
from .identifiers.prediction_errors import PredictionError
from .identifiers.recursive_output_error import RecursiveOutputError
from .identifiers.subspace import Subspace
from .models.armax import ARMAX
from .models.arx import ARX
from .models.controlled import Change, ControlledPlant, Failure
from .models.files import GainSection, ModelFile, read_model, write_model
from .models.nonlinear import NonlinearModel
from .models.operating_point import OperatingPoint
from .models.output_error import OutputError
from .models.prior import Prior
from .models.state_space import StateSpace
from .models.uncorrelated import uncorrelated
from .networks.delivery import Delivery
from .networks.links import BernoulliLink, DelayLink, GilbertElliottLink, PerfectLink
from .networks.trace import Trace
from .results import (
    Check,
    Estimate,
    EstimateBank,
    Fit,
    Forecast,
    Info,
    Interval,
    Outcome,
    Sample,
    Simulation,
    SmoothedEstimate,
    Validation,
)
from .results.orders import OrderSelection
from .run.choose_orders import choose_orders
from .run.close_loop import ClosedLoop, ClosedLoopBank, close_loop, close_loop_bank
from .run.compare import Comparison, compare
from .run.estimate import estimate, log_likelihood
from .run.estimate_bank import estimate_bank
from .run.fit_noise import NoiseFit, fit_noise
from .run.forecast import forecast
from .run.identify import identify
from .run.monte_carlo import MonteCarlo, monte_carlo
from .run.monte_carlo_loops import LoopCase, loop_grid, monte_carlo_loops
from .run.online import Online, online
from .run.select_order import select_order
from .run.simulate import drawn_from, simulate, simulate_bank
from .run.smooth import smooth
from .run.stack import Stacked, stack
from .store import load, save

__version__ = "0.1.0"

__all__ = [
    "ARMAX",
    "ARX",
    "AdaptiveIdentification",
    "AlphaBeta",
    "ArrivalCovariance",
    "AssumptionError",
    "BernoulliLink",
    "Bounded",
    "Change",
    "ChangeDetection",
    "Check",
    "ClosedLoop",
    "ClosedLoopBank",
    "Comparison",
    "ControlledPlant",
    "CoupledLeastSquares",
    "DelayLink",
    "Delivery",
    "DesignFamily",
    "DisturbanceAccommodation",
    "Dither",
    "Estimability",
    "EstimableError",
    "EstimableWarning",
    "Estimate",
    "EstimateBank",
    "ExtendedKalman",
    "Failure",
    "FeedbackGain",
    "Fit",
    "FixedGain",
    "Forecast",
    "GainInformation",
    "GainReconfiguration",
    "GainSection",
    "Gated",
    "GilbertElliottLink",
    "HoKalman",
    "Info",
    "InputError",
    "InstrumentalVariables",
    "Interval",
    "JointOutputError",
    "Kalman",
    "KalmanGain",
    "LeastSquares",
    "LoopCase",
    "LossTolerance",
    "MarkovParameters",
    "MinimumVariance",
    "ModelFile",
    "MonteCarlo",
    "MovingWindow",
    "NoiseFit",
    "NonlinearModel",
    "Observability",
    "Online",
    "OperatingPoint",
    "OrderSelection",
    "Outcome",
    "OutputError",
    "OutputErrorML",
    "PerfectLink",
    "Perturbed",
    "Phasor",
    "PredictionError",
    "Prior",
    "ProportionalIntegral",
    "Reachability",
    "Record",
    "RecursiveOutputError",
    "Reduction",
    "Regulability",
    "RhoMargin",
    "RhoSynthesis",
    "RunError",
    "Sample",
    "SecondOrderKalman",
    "Simulation",
    "Smoothed",
    "SmoothedEstimate",
    "StabilityRadius",
    "Stacked",
    "StateFeedback",
    "StateSpace",
    "Subspace",
    "Trace",
    "TrackerChoices",
    "Tracking",
    "TransKalman",
    "Trend",
    "UnknownGain",
    "UnknownInput",
    "UnknownInputExistence",
    "UnscentedKalman",
    "Validation",
    "Waveform",
    "alpha_beta_choices",
    "alpha_beta_covariance",
    "alpha_beta_gains",
    "alpha_beta_gamma_gains",
    "catalogue",
    "choose_orders",
    "close_loop",
    "close_loop_bank",
    "compare",
    "diagnostics",
    "disturbance_accommodation",
    "drawn_from",
    "estimability",
    "estimate",
    "estimate_bank",
    "excitation",
    "filter_covariance",
    "fit_noise",
    "forecast",
    "gain_information",
    "identify",
    "kalman_gain",
    "load",
    "log_likelihood",
    "loop_grid",
    "loss_tolerance",
    "lqr_gain",
    "monte_carlo",
    "monte_carlo_loops",
    "observability",
    "online",
    "packaged",
    "plants",
    "positive_real_margin",
    "reachability",
    "read_model",
    "read_record",
    "reduce",
    "regulability",
    "report",
    "rho_margin",
    "rho_synthesis",
    "save",
    "select_order",
    "simulate",
    "simulate_bank",
    "smooth",
    "stability_radius",
    "stack",
    "trans_kalman",
    "uncorrelated",
    "unknown_input_existence",
    "write_model",
]
