"""The public names, by the modules that define them."""

from . import plot as plot
from .api.cubes import claims as claims
from .api.cubes import compare as compare
from .api.cubes import explore as explore
from .api.cubes import export as export
from .api.cubes import find as find
from .api.cubes import query as query
from .api.design import design as design
from .api.knitting import knit as knit
from .api.knitting import read_chart as read_chart
from .api.laboratory import calibrate as calibrate
from .api.laboratory import fit as fit
from .api.plates import plate_stiffness as plate_stiffness
from .api.simulation import Design as Design
from .api.simulation import NotConverged as NotConverged
from .api.simulation import evaluate as evaluate
from .api.simulation import simulate as simulate
from .api.stability import branches as branches
from .api.stability import shapes as shapes
from .api.sweeps import NotAllOk as NotAllOk
from .api.sweeps import merge as merge
from .api.sweeps import plan as plan
from .api.sweeps import run as run
from .api.uncertainty import sample_stripes as sample_stripes
from .api.uncertainty import uncertainty as uncertainty
from .cube.cube_file import open_cube as open_cube
from .dynamics.settings import Dynamics as Dynamics
from .equilibrium.settings import Solver as Solver
from .fabric.electrodes import ElectrodeLayout as ElectrodeLayout
from .fabric.settings import PlainKnit as PlainKnit
from .fabric.settings import Sheet as Sheet
from .fabric.stripe import Stripe as Stripe
from .io.errors import BadInput as BadInput
from .laboratory.experiment import import_records as import_records
from .laboratory.tension_record import read_tension_record as read_tension_record
from .measure.capacitance.capacitor import Capacitor as Capacitor
from .measure.knit_size import Gauge as Gauge
from .sweep.material import Material as Material
from .sweep.parameters import Model as Model
from .sweep.parameters import defaults as defaults
from .sweep.patterns import Pattern as Pattern
from .sweep.reproduce import reproduce as reproduce
from .sweep.results_folder import status as status
from .sweep.workflow import Protocol as Protocol

__version__: str
